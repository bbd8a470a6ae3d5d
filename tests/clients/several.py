"""Several valves on one bus, and one network object that finds, drives and configures them all.

On the bus: pvea-canopen at 0x05 and 0x20, pveo-canopen at 0x7F, and a blank pvea-canopen; serial numbers from 0x101 on.
"""

from canopen.lss import CS_INQUIRE_SERIAL_NUMBER

from valve import ACTIVE, CYCLE, DISABLED, HOLD, INIT, NODE_ID, connected, equal

IDS = {0x05: 0x101, NODE_ID: 0x102, 0x7F: 0x103}
ON_OFF = 0x7F
BLANK_ID, BLANK_SERIAL = 0x40, 0x104
PRODUCT = 0x01000019, 0x53360000, 0x00010020


def serials(nodes):
    return {node_id: node.sdo[0x1018][4].raw for node_id, node in nodes.items()}


def found_by_scanning(valve):
    """python-canopen's scanner asks all 127 IDs."""
    scanner = valve.network.scanner
    valve.heard.forget()
    scanner.search()
    # the last of those it asks is one that answers
    valve.heard.expect(0x580 + max(IDS), lambda data: True)
    equal("found", sorted(scanner.nodes), sorted(IDS))


def driven(valve, nodes):
    """Each by its own RPDO, each to its own set-point."""
    for node in nodes.values():
        node.rpdo.read()
        node.tpdo.read()
    valve.network.nmt.state = "OPERATIONAL"
    for status in (DISABLED, HOLD, ACTIVE):
        for node in nodes.values():
            node.rpdo[1][0x6040].raw = 0x0F
            node.rpdo[1].transmit()
            valve.expect_status(status, 0, node)
    set_points = {0x05: 4096, NODE_ID: -8192, ON_OFF: 1}
    for node_id, node in nodes.items():
        node.rpdo[1][0x6300].raw = set_points[node_id]
        node.rpdo[1].start(CYCLE)
    # an on/off valve goes all the way, however small the set-point
    positions = {**set_points, ON_OFF: 16384}
    for node_id, node in nodes.items():
        valve.expect_status(ACTIVE, positions[node_id], node)
        equal("6301:1", node.sdo[0x6301][1].raw, positions[node_id])
        equal("6300:1", node.sdo[0x6300][1].raw, set_points[node_id])
    # nobody has followed another one
    equal("status", [node.sdo[0x6041].raw for node in nodes.values()], 3 * [ACTIVE])
    for node in nodes.values():
        node.rpdo[1].stop()


def synchronised(valve, nodes):
    """One SYNC, and all of them answer at once: in the order of arbitration."""
    valve.network.nmt.state = "RESET"
    for node in nodes.values():
        valve.heard.expect(0x080 + node.id, bytes(8))
    for node in nodes.values():
        node.sdo[0x1800][2].raw = 1
    valve.network.nmt.state = "OPERATIONAL"
    for _ in range(10):
        valve.heard.forget()
        valve.network.sync.transmit()
        frames = [valve.heard.next() for _ in nodes]
        # the spools are still on their way home
        seen = [(frame.arbitration_id, frame.data[0]) for frame in frames]
        equal("TPDOs", seen, [(0x180 + node_id, INIT) for node_id in sorted(nodes)])


def one_stopped(valve, nodes):
    """A command to one of them is none to the others."""
    nodes[0x05].nmt.state = "STOPPED"
    valve.heard.forget()
    valve.network.sync.transmit()
    frames = [valve.heard.next().arbitration_id for _ in range(2)]
    equal("TPDOs", frames, [0x180 + NODE_ID, 0x180 + ON_OFF])
    valve.network.nmt.state = "PRE-OPERATIONAL"


def one_selected(valve, nodes):
    """LSS by serial number reaches one of many."""
    lss = valve.network.lss
    for serial in IDS.values():
        lss.send_switch_state_global(lss.WAITING_STATE)
        assert lss.send_switch_state_selective(*PRODUCT, serial), f"{serial:X} not selected"
        equal("serial number", lss.inquire_lss_address(CS_INQUIRE_SERIAL_NUMBER), serial)
    # the last of them gets the node ID of the first, which then has another
    lss.configure_node_id(0x06)
    lss.store_configuration()
    valve.heard.forget()
    lss.send_switch_state_global(lss.WAITING_STATE)
    moved = valve.at(0x06)
    valve.expect_boot(moved)
    equal("serial number", moved.sdo[0x1018][4].raw, IDS[ON_OFF])
    equal("the others", serials({node_id: nodes[node_id] for node_id in (0x05, NODE_ID)}), {0x05: 0x101, NODE_ID: 0x102})
    return {0x05: nodes[0x05], 0x06: moved, NODE_ID: nodes[NODE_ID]}


def blank_one_found(valve, nodes):
    """Only the valve without an ID takes part in the scan; then it is a node like the others."""
    lss = valve.network.lss
    lss.send_switch_state_global(lss.CONFIGURATION_STATE)
    found, identity = valve.fast_scan(valve.until_now)
    equal("found", (found, identity), (True, [*PRODUCT, BLANK_SERIAL]))
    lss.send_switch_state_global(lss.WAITING_STATE)
    assert lss.send_switch_state_selective(*identity), "the one found is not selected by what was found"
    lss.configure_node_id(BLANK_ID)
    lss.store_configuration()
    valve.heard.forget()
    lss.send_switch_state_global(lss.WAITING_STATE)
    nodes[BLANK_ID] = valve.at(BLANK_ID)
    valve.expect_boot(nodes[BLANK_ID])
    equal("serial numbers", sorted(serials(nodes).values()), [0x101, 0x102, 0x103, 0x104])


with connected() as valve:
    nodes = {node_id: valve.node if node_id == NODE_ID else valve.at(node_id) for node_id in IDS}
    equal("serial numbers", serials(nodes), IDS)
    found_by_scanning(valve)
    driven(valve, nodes)
    synchronised(valve, nodes)
    one_stopped(valve, nodes)
    blank_one_found(valve, one_selected(valve, nodes))
