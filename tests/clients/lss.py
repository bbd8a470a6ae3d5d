"""Use case 4 with python-canopen's LSS master: selects the valve by its identity, gives it another node ID, and back."""

from canopen import lss as service
from canopen.lss import LssError

from valve import NODE_ID, connected, equal

OTHER_ID = 0x33

with connected() as valve:
    network, lss = valve.network, valve.network.lss
    valve.reset()
    identity = [valve.node.sdo[0x1018][sub].raw for sub in range(1, 5)]
    equal("identity", identity[:3], [0x01000019, 0x53360000, 0x00010020])

    # a number that does not fit selects nobody
    valve.node.nmt.state = "STOPPED"
    lss.send_switch_state_global(lss.WAITING_STATE)
    with valve.silence_after(valve.until_now):
        try:
            lss.send_switch_state_selective(*identity[:3], identity[3] ^ 1)
        except LssError:
            pass
        else:
            raise AssertionError("selected by a wrong serial number")

    assert lss.send_switch_state_selective(*identity), "not selected by its identity"
    for command, number in zip(
        (
            service.CS_INQUIRE_VENDOR_ID,
            service.CS_INQUIRE_PRODUCT_CODE,
            service.CS_INQUIRE_REVISION_NUMBER,
            service.CS_INQUIRE_SERIAL_NUMBER,
        ),
        identity,
    ):
        equal(f"inquiry {command:02X}", lss.inquire_lss_address(command), number)
    equal("inquired node ID", lss.inquire_node_id(), NODE_ID)

    # out of range first: answered, and nothing changes
    for refused in (
        lambda: lss.configure_node_id(0x80),
        lambda: lss.configure_bit_timing(0),
    ):
        try:
            refused()
        except LssError as error:
            equal("refusal", str(error), "LSS Error: 1")
        else:
            raise AssertionError("taken although out of range")

    lss.configure_node_id(OTHER_ID)
    equal("node ID in force", lss.inquire_node_id(), NODE_ID)
    lss.store_configuration()
    other = valve.at(OTHER_ID)
    valve.heard.forget()
    lss.send_switch_state_global(lss.WAITING_STATE)
    valve.expect_boot(other)

    # everything follows the node ID of a valve that was never saved, and a reset does not take it back
    equal("1400:1", other.sdo[0x1400][1].raw, 0x200 + OTHER_ID)
    valve.reset(other)
    equal("1800:1", other.sdo[0x1800][1].raw, 0x180 + OTHER_ID)

    # and back, globally, as in use case 3
    network.nmt.state = "STOPPED"
    lss.send_switch_state_global(lss.CONFIGURATION_STATE)
    lss.configure_node_id(NODE_ID)
    lss.store_configuration()
    valve.heard.forget()
    lss.send_switch_state_global(lss.WAITING_STATE)
    valve.expect_boot(valve.node)
    equal("identity", [valve.node.sdo[0x1018][sub].raw for sub in range(1, 5)], identity)
