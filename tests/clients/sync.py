"""Has the TPDO sent by python-canopen's SYNC producer: at every SYNC, at every n-th, and no more when that ends."""

import can

from valve import DISABLED, INIT, INVALID, NODE_ID, Heard, aborted, connected, equal

SYNC, TPDO, SDO_ANSWER = 0x080, 0x180 + NODE_ID, 0x580 + NODE_ID
#: Seconds from SYNC to SYNC: seldom enough that the answer to one is out before the next, on a busy machine as well.
PERIOD = 0.02


def answers(valve, syncs):
    """To which of so many SYNCs, each on its own, a TPDO comes."""
    return [number for number in range(1, syncs + 1) for _ in range(tpdos(valve, 1))]


def tpdos(valve, syncs):
    """How many TPDOs come, and nothing else does, when so many SYNCs are sent as fast as the client can."""
    valve.heard.forget()
    for _ in range(syncs):
        valve.network.sync.transmit()
    # the answer to this read comes after all that the SYNCs have caused
    valve.node.sdo[0x1000].raw
    frames = valve.heard.until(SDO_ANSWER)
    equal("frames", set(frames) - {TPDO, SDO_ANSWER}, set())
    return len(frames) - 1


def one_by_one(valve):
    transmission_type = valve.node.sdo[0x1800][2]
    transmission_type.raw = 1
    equal("type 1", answers(valve, 4), [1, 2, 3, 4])
    # SYNCs that follow each other at once keep the TPDO from the bus: it tells the state after the last of them
    seen = tpdos(valve, 10)
    assert 1 <= seen <= 10, f"type 1, all at once: {seen!r}"
    transmission_type.raw = 3
    equal("type 3", answers(valve, 10), [3, 6, 9])
    # the count starts anew with the type, and with entering operational
    equal("type 3, one over", answers(valve, 1), [])
    transmission_type.raw = 2
    equal("type 2", answers(valve, 4), [2, 4])
    equal("type 2, one over", answers(valve, 1), [])
    valve.node.nmt.state = "PRE-OPERATIONAL"
    equal("pre-operational", answers(valve, 3), [])
    valve.node.nmt.state = "OPERATIONAL"
    equal("operational again", answers(valve, 3), [2])
    transmission_type.raw = 240
    equal("type 240", answers(valve, 241), [240])
    transmission_type.raw = 255
    equal("type 255", answers(valve, 3), [])
    for reserved in (0, 241, 254):
        with aborted(INVALID):
            transmission_type.raw = reserved
    equal("1800:2", transmission_type.raw, 255)


def sampled(valve):
    """A TPDO of SYNC shows what is so at the SYNC; an RPDO acts at once and is not answered."""
    valve.node.sdo[0x1800][2].raw = 1
    valve.heard.forget()
    valve.network.sync.transmit()
    valve.expect_status(INIT)
    valve.command(0x01, 77)
    equal("6300:1", valve.node.sdo[0x6300][1].raw, 77)
    valve.network.sync.transmit()
    valve.heard.expect(TPDO, lambda data: data[0] == DISABLED, without=[TPDO])


def check_answers(heard, every):
    """To every n-th SYNC there is a TPDO. SYNCs that follow at once, from a client that was held up, keep it waiting."""
    owed, syncs, last = False, 0, 0
    for frame in heard:
        if frame.arbitration_id == SYNC:
            assert not owed or frame.timestamp - last < 0.001, f"no TPDO at SYNC {syncs}"
            syncs, last = syncs + 1, frame.timestamp
            owed = owed or syncs % every == 0
        elif frame.arbitration_id == TPDO:
            assert owed, f"a TPDO at SYNC {syncs}"
            owed = False
    assert not owed, f"no TPDO at SYNC {syncs}"


def by_the_producer(valve, every, rounds):
    """Counts SYNCs and TPDOs where both are heard: at another client."""
    valve.node.sdo[0x1800][2].raw = every
    received = []
    valve.node.tpdo[1].add_callback(lambda pdo: received.append(pdo[0x6041].raw))
    with can.Bus(**valve.address) as bus:
        ear = Heard()
        notifier = can.Notifier(bus, [ear], 0.1)
        valve.network.sync.start(PERIOD)
        heard = [ear.expect(SYNC, b"")]
        while sum(frame.arbitration_id == TPDO for frame in heard) < rounds:
            heard.append(ear.next())
        valve.network.sync.stop()
        # the first read lets a last SYNC and what it causes go by, the second tells when that is over
        for _ in range(2):
            valve.node.sdo[0x1000].raw
        answered = 0
        while answered < 2:
            heard.append(ear.next())
            answered += heard[-1].arbitration_id == SDO_ANSWER
        notifier.stop()
    valve.node.tpdo[1].callbacks.clear()
    seen = [frame.arbitration_id for frame in heard]
    check_answers(heard, every)
    equal("status of those that python-canopen has seen", received, seen.count(TPDO) * [DISABLED])
    # a TPDO comes as soon as the bus lets it: well within the 1 ms that both frames take
    for number, frame in enumerate(heard):
        if frame.arbitration_id == TPDO and heard[number - 1].arbitration_id == SYNC:
            delay = frame.timestamp - heard[number - 1].timestamp
            assert delay < 0.001, f"{delay} s from SYNC to TPDO"


def another_identifier(valve):
    valve.node.sdo[0x1800][2].raw = 1
    valve.node.sdo[0x1005].raw = valve.network.sync.cob_id = 0x0FF
    equal("SYNC 0FF", answers(valve, 2), [1, 2])
    valve.network.sync.cob_id = SYNC
    equal("SYNC 080", answers(valve, 2), [])
    valve.node.sdo[0x1005].raw = SYNC


with connected() as valve:
    valve.node.rpdo.read()
    valve.node.tpdo.read()
    valve.node.nmt.state = "OPERATIONAL"
    one_by_one(valve)
    sampled(valve)
    by_the_producer(valve, every=1, rounds=20)
    by_the_producer(valve, every=3, rounds=8)
    another_identifier(valve)
