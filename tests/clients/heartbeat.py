"""python-canopen consumes the valve's heartbeat: its period, its phase, and the state that it tells."""

from valve import BOOT_UP, NODE_ID, PATIENCE, TOO_HIGH, aborted, connected, equal

HEARTBEAT, SDO_ANSWER = 0x700 + NODE_ID, 0x580 + NODE_ID
#: Two frames before it can put a heartbeat off by some 1.1 ms.
TOLERANCE_MS = 1.2


def periods(frames):
    """Milliseconds from each to the next, of the valve's time."""
    return [(after.timestamp - before.timestamp) * 1000 for before, after in zip(frames, frames[1:])]


def expect_period(frames, period_ms):
    for period in periods(frames):
        assert abs(period - period_ms) < TOLERANCE_MS, f"{periods(frames)}, not {period_ms} ms each"


def any_state(data):
    return len(data) == 1


def produced(valve):
    heartbeat = valve.node.sdo[0x1017]
    # the period is rounded up to 10 ms, and read back as it was written
    for written, period_ms in ((100, 100), (41, 50), (1, 10), (10, 10), (500, 500)):
        heartbeat.raw = 0
        valve.until_now()
        heartbeat.raw = written
        equal("1017", heartbeat.raw, written)
        answer = valve.heard.expect(SDO_ANSWER, lambda data: data[0] == 0x60)
        frames = [valve.heard.expect(HEARTBEAT, b"\x7F") for _ in range(4)]
        expect_period(frames, period_ms)
        assert frames[0].timestamp - answer.timestamp < 0.002, "the first did not come at once"
    with aborted(TOO_HIGH):
        heartbeat.raw = 0x8000
    equal("1017", heartbeat.raw, 500)


def tracked(valve):
    """The state is that of the wire, not that of the last command; and commands do not move the heartbeat."""
    nmt = valve.node.nmt
    valve.node.sdo[0x1017].raw = 20
    seen = []
    nmt.add_heartbeat_callback(seen.append)
    valve.heard.forget()
    frames = []
    for state, code in (("OPERATIONAL", 5), ("STOPPED", 4), ("PRE-OPERATIONAL", 127), ("OPERATIONAL", 5)):
        # past the master that tracks it
        valve.network.send_message(0, [{5: 1, 4: 2, 127: 128}[code], NODE_ID])
        while not frames or frames[-1].data[0] != code:
            frames.append(valve.heard.expect(HEARTBEAT, any_state))
        nmt.wait_for_heartbeat(PATIENCE)
        equal("NMT state", nmt.state, state)
    expect_period(frames, 20)
    changes = [after for before, after in zip([None] + seen, seen) if before != after]
    equal("states", changes[-4:], [5, 4, 127, 5])


def after_a_boot(valve):
    """A stored heartbeat goes on after the boot-up, which counts as the first."""
    nmt = valve.node.nmt
    valve.node.nmt.state = "PRE-OPERATIONAL"
    valve.node.sdo[0x1017].raw = 50
    valve.node.store()
    for command in ("RESET", "RESET COMMUNICATION"):
        valve.heard.forget()
        nmt.state = command
        boot = valve.heard.expect(HEARTBEAT, BOOT_UP)
        expect_period([boot] + [valve.heard.expect(HEARTBEAT, b"\x7F", without=[HEARTBEAT]) for _ in range(4)], 50)


def ended(valve):
    """Without a heartbeat nobody waits for ever."""
    valve.node.sdo[0x1017].raw = 0
    valve.until_now()
    for _ in range(50):
        valve.node.sdo[0x1000].raw
    equal("frames", set(valve.until_now()), {SDO_ANSWER})


with connected() as valve:
    valve.reset()
    produced(valve)
    tracked(valve)
    after_a_boot(valve)
    ended(valve)
