"""Every NMT command, to the valve and to all, seen by its heartbeat and by which services answer."""

from canopen.nmt import NMT_COMMANDS

from valve import FAULT_HOLD, INIT, NODE_ID, PATIENCE, connected, equal

HEARTBEAT, SDO_ANSWER, TPDO, LSS_ANSWER = 0x700 + NODE_ID, 0x580 + NODE_ID, 0x180 + NODE_ID, 0x7E4
PERIOD_MS = 20
#: A request, and the identifier of its answer. That of LSS is the inquiry for the node ID.
SERVICES = {
    (0x600 + NODE_ID, bytes.fromhex("40 00 10 00 00 00 00 00")): SDO_ANSWER,
    (0x200 + NODE_ID, bytes(4)): TPDO,
    (0x7E5, bytes.fromhex("5E 00 00 00 00 00 00 00")): LSS_ANSWER,
}
#: Who answers in which state.
SERVED = {"PRE-OPERATIONAL": {SDO_ANSWER, LSS_ANSWER}, "OPERATIONAL": {SDO_ANSWER, TPDO}, "STOPPED": {LSS_ANSWER}}


def expect_state(valve, state):
    """The valve is in this state, and serves what it is to serve there."""
    valve.until_now()
    valve.node.nmt.wait_for_heartbeat(PATIENCE)
    equal("NMT state", valve.node.nmt.state, state)
    for request, answer in SERVICES.items():
        valve.heard.forget()
        valve.network.send_message(*request)
        equal(f"{answer:03X} in {state}", answer in valve.until_now(), answer in SERVED[state])


def every_transition(valve):
    for to_all in (False, True):
        for before in SERVED:
            for after in SERVED:
                for state in (before, after):
                    (valve.network if to_all else valve.node).nmt.state = state
                # starting the node has ended LSS configuration
                valve.network.lss.send_switch_state_global(valve.network.lss.CONFIGURATION_STATE)
                expect_state(valve, after)


def resets(valve):
    nmt = valve.node.nmt
    for to_all in (False, True):
        for command, status in (("RESET", INIT), ("INITIALISING", INIT), ("RESET COMMUNICATION", FAULT_HOLD)):
            for before in SERVED:
                nmt.state = before
                valve.heard.forget()
                # whoever holds the condition sees to it that nothing comes before the wait for it
                with nmt.state_update:
                    (valve.network if to_all else valve.node).nmt.state = command
                    nmt.wait_for_bootup(PATIENCE)
                valve.expect_boot(valve.node)
                equal(f"{command} from {before}", nmt.state, "PRE-OPERATIONAL")
                equal("6041", valve.node.sdo[0x6041].raw, status)
                # the heartbeat was not stored
                equal("1017", valve.node.sdo[0x1017].raw, 0)


def nothing_for_it(valve):
    """Commands that it does not know or that are for others; remote frames; and the time of day."""
    valve.node.sdo[0x1017].raw = PERIOD_MS
    valve.node.nmt.state = "OPERATIONAL"
    other = valve.at(NODE_ID + 1)
    for command in NMT_COMMANDS:
        other.nmt.state = command
    for command in (0, 3, 0x7F, 0x83, 0xFF):
        valve.network.nmt.send_command(command)
    for short in (b"", b"\x02", bytes([2, NODE_ID, 0])):
        valve.network.send_message(0, short)
    for unknown in ("SLEEP", "STANDBY"):
        valve.node.nmt.state = unknown
    valve.network.time.transmit()
    expect_state(valve, "OPERATIONAL")

    # node guarding is none of its services, and a TPDO is not sent on request; python-can sends both as empty frames
    valve.heard.forget()
    valve.node.nmt.start_node_guarding(0.005)
    for _ in range(10):
        valve.node.tpdo[1].remote_request()
        valve.heard.expect(HEARTBEAT, b"\x05", without=[TPDO])
    valve.node.nmt.stop_node_guarding()
    heartbeats = [valve.heard.expect(HEARTBEAT, b"\x05", without=[HEARTBEAT, TPDO]) for _ in range(10)]
    for before, after in zip(heartbeats, heartbeats[1:]):
        equal("ms between heartbeats", round((after.timestamp - before.timestamp) * 1000), PERIOD_MS)


with connected() as valve:
    valve.reset()
    valve.node.rpdo.read()
    valve.node.tpdo.read()
    valve.node.sdo[0x1017].raw = PERIOD_MS
    every_transition(valve)
    valve.network.lss.send_switch_state_global(valve.network.lss.WAITING_STATE)
    resets(valve)
    nothing_for_it(valve)
