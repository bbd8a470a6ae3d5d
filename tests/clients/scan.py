"""Finds a blank valve by fast scan, and gives it a node ID. It takes part in LSS configuration only (behaviour 4.4)."""

from valve import NODE_ID, PATIENCE, connected, equal

with connected() as valve:
    lss = valve.network.lss
    lss.send_switch_state_global(lss.CONFIGURATION_STATE)
    # a bit that is set is one that nobody answers for: this long each
    lss.RESPONSE_TIMEOUT = 1.0
    found, identity = lss.fast_scan()
    assert found, "no blank valve found"
    equal("identity", [hex(number) for number in identity], ["0x1000019", "0x53360000", "0x10020", "0x5b2e0100"])
    lss.RESPONSE_TIMEOUT = PATIENCE

    lss.configure_node_id(NODE_ID)
    lss.store_configuration()
    valve.heard.forget()
    lss.send_switch_state_global(lss.WAITING_STATE)
    valve.expect_boot(valve.node)
    equal("1018:4", valve.node.sdo[0x1018][4].raw, identity[3])

    # it has an ID now: a scan finds nobody
    lss.send_switch_state_global(lss.CONFIGURATION_STATE)
    lss.RESPONSE_TIMEOUT = 1.0
    equal("second scan", lss.fast_scan(), (False, None))
