"""The valve's emergencies in python-canopen's log, callbacks and waits; and an emergency of another node that stops it."""

from canopen.objectdictionary import ObjectDictionary

from valve import ACTIVE, CYCLE, FAULT_HOLD, HOLD, NO_DATA, NODE_ID, PATIENCE, aborted, connected, equal

TIME_GUARDING, INTERNAL = 0x8003, 0x1000
OTHER_NODE = 0x10


def logged(emcy):
    return [(emcy.code, emcy.register, emcy.data.hex()) for emcy in emcy.log]


def starve(valve, count):
    """Sends no set-points any more, and waits for the emergency that the valve sends then."""
    emcy = valve.node.emcy
    # whoever holds the condition sees to it that nothing is logged before the wait for it
    with emcy.emcy_received:
        valve.node.rpdo[1].stop()
        entry = emcy.wait(TIME_GUARDING, timeout=PATIENCE)
    assert entry, "no emergency"
    equal("emergency", (entry.code, entry.register, entry.data.hex()), (TIME_GUARDING, 0x91, f"{count:02x}00000000"))
    equal("in words", entry.get_desc(), "Monitoring")
    equal("active", [active.code for active in emcy.active], [TIME_GUARDING])
    equal("1001", valve.node.sdo[0x1001].raw, 0x91)


def recover(valve):
    """Resets the fault, and goes on."""
    with valve.node.emcy.emcy_received:
        valve.command(0x03)
        entry = valve.node.emcy.wait(0x0000, timeout=PATIENCE)
    assert entry, "no end of the emergency"
    equal("in words", entry.get_desc(), "Error Reset / No Error")
    equal("active", valve.node.emcy.active, [])
    equal("1001", valve.node.sdo[0x1001].raw, 0)
    activate(valve)


def activate(valve):
    """From FAULT_HOLD, after the first reset message."""
    for control_word, status in ((0x0B, HOLD), (0x0F, ACTIVE)):
        valve.command(control_word)
        valve.expect_status(status)
    valve.node.rpdo[1].start(CYCLE)


def cycle(valve, control_word, status):
    """Puts another control word into the cyclic RPDO, and waits until that was surely sent."""
    valve.node.rpdo[1][0x6040].raw = control_word
    valve.heard.forget()
    for _ in range(2):
        valve.heard.expect(0x180 + NODE_ID, lambda data: True)
    valve.expect_status(status)


def of_its_own(valve):
    emcy, sdo = valve.node.emcy, valve.node.sdo
    called = []
    emcy.add_callback(lambda entry: called.append((entry.code, entry.register, entry.data.hex())))
    valve.boot_to_active()
    emcy.reset()
    called.clear()
    starve(valve, 1)
    recover(valve)
    starve(valve, 2)
    end = (0, 0, "0000000000")
    equal("log", logged(emcy), [(0x8003, 0x91, "0100000000"), end, (0x8003, 0x91, "0200000000")])
    equal("called", called, logged(emcy))

    # the history, newest first
    equal("1003", [sdo[0x1003][sub].raw for sub in range(3)], [2, 0x0002_8003, 0x0001_8003])
    with aborted(NO_DATA):
        sdo[0x1003][3].raw
    equal("2023", sdo[0x2023].raw, 2)
    # counters and history are cleared, each on its own; the fault stays
    sdo.download(0x1011, 5, b"pkds")
    equal("2023", sdo[0x2023].raw, 0)
    equal("1003:0", sdo[0x1003][0].raw, 2)
    sdo[0x1003][0].raw = 0
    equal("1003:0", sdo[0x1003][0].raw, 0)
    equal("6041", sdo[0x6041].raw, FAULT_HOLD)
    emcy.reset()
    equal("log", (emcy.log, emcy.active), ([], []))
    recover(valve)


def of_another(valve):
    """A node of python-canopen's own is the emergency-stop producer (object 0x1028)."""
    producer = valve.network.create_node(OTHER_NODE, ObjectDictionary()).emcy
    sdo = valve.node.sdo
    valve.node.emcy.reset()

    # not before it is told whom to listen to
    producer.send(INTERNAL, 1)
    equal("6041", sdo[0x6041].raw, ACTIVE)
    sdo[0x1028][1].raw = producer.cob_id
    # nor to what else that one has to say
    for code in (0x0000, 0x8130, 0x1001):
        producer.send(code, 1)
    equal("6041", sdo[0x6041].raw, ACTIVE)

    valve.heard.forget()
    producer.send(INTERNAL, 1)
    valve.expect_status(FAULT_HOLD)
    equal("6041", sdo[0x6041].raw, FAULT_HOLD)
    equal("1001", sdo[0x1001].raw, 0)
    equal("1003:0", sdo[0x1003][0].raw, 0)
    # it is no fault of this one: no emergency, and the way out is open at once
    for control_word, status in ((0x03, FAULT_HOLD), (0x0B, HOLD), (0x0F, ACTIVE)):
        cycle(valve, control_word, status)
    equal("log", logged(valve.node.emcy), [])

    # in hand operation too, but not in HOLD, and not when it is switched off
    sdo[0x6042].raw = 2
    producer.send(INTERNAL)
    equal("6041", sdo[0x6041].raw, FAULT_HOLD)
    cycle(valve, 0x03, FAULT_HOLD)
    cycle(valve, 0x0B, HOLD)
    producer.send(INTERNAL)
    equal("6041", sdo[0x6041].raw, HOLD)
    cycle(valve, 0x0F, ACTIVE)
    sdo[0x1028][1].raw = 1 << 31
    producer.send(INTERNAL)
    equal("6041", sdo[0x6041].raw, ACTIVE)
    equal("log", logged(valve.node.emcy), [])


with connected() as valve:
    of_its_own(valve)
    of_another(valve)
