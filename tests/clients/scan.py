"""Finds a blank valve by fast scan, and gives it a node ID. It takes part in LSS configuration only (behaviour 4.4).

Beside it is a valve on ISOBUS, which takes no part in LSS and answers when the blank valve does not.
"""

from valve import NODE_ID, connected, equal

WITNESS = 0x83
#: The estimated flow of the valve with that address: it answers from then on, 250 ms after its claim.
AVEF = 0x0CFE1383

with connected() as valve:
    valve.heard.until(AVEF)
    lss = valve.network.lss
    lss.send_switch_state_global(lss.CONFIGURATION_STATE)
    found, identity = valve.fast_scan(lambda: valve.until_now(WITNESS))
    assert found, "no blank valve found"
    equal("identity", [hex(number) for number in identity], ["0x1000019", "0x53360000", "0x10020", "0x5b2e0100"])

    lss.configure_node_id(NODE_ID)
    lss.store_configuration()
    valve.heard.forget()
    lss.send_switch_state_global(lss.WAITING_STATE)
    valve.expect_boot(valve.node)
    equal("1018:4", valve.node.sdo[0x1018][4].raw, identity[3])

    # it has an ID now: a scan finds nobody
    lss.send_switch_state_global(lss.CONFIGURATION_STATE)
    equal("second scan", valve.fast_scan(lambda: valve.until_now(WITNESS)), (False, None))
