"""A plain model of the valves on ISOBUS, written from docs/behaviour.md section 5, the manual, and J1939."""

import struct

from canopen import BUS_US, LATE_US, MEMORY_US, NEVER, Expected, Sender, Undecided, scaled
from valve import FLOAT, Causes

LONG = 1 << 31
# name: (DTC, lamp), by priority
CODES = {
    "internal": (0x8B8FFA, 0x10), "temperature": (0x908FF1, 0x04), "supply-high": (0x030273, 0x04),
    "supply-low": (0x040273, 0x04), "time-guarding": (0x938FE9, 0x04),
}  # fmt: skip
BLOCKED, EXTEND, RETRACT, FLOATING, HAND, STOP = 0, 1, 2, 3, 10, 14
WORDS = {0: "blocked", 1: "extend", 2: "retract", 3: "float", 10: "hand", 14: "emergency-stop"}
NAME = bytes.fromhex("0100200708FF0220")
GLOBAL, NULL = 0xFF, 0xFE
#: The DTC of a spool that is not where it should be.
SPOOL = bytes.fromhex("EC8F87")
#: The longest way of the springs to neutral.
SPRINGS_US = 150_000
#: How exactly the grid of the AVEF is known: bits are stuffed, or not.
GRID_US = 50


class Valve(Causes, Sender):
    coldest = -1000  # ISOBUS has no limit below

    def __init__(self, kind):
        self.kind, self.address, self.now, self.expected = kind, 0x80, 0, []
        self.plant = dict(supply_mv=24000, temperature_c=25, internal_fault=False)
        self.counters, self.active, self.shut_down, self.since = dict.fromkeys(CODES, 0), [], [], {}
        # Counters before the last DM3, the instant until which it may not have been carried out, and those that it may have left.
        self.before_dm3, self.dm3_until, self.kept = {}, 0, {}
        self.shutdown_at = self.guard_from = NEVER
        self.away_until = 0
        self.state_now, self.set_point, self.neutral_count, self.changed = BLOCKED, 0, 0, 0
        self.flow_due, self.dm1_due, self.bam, self.claimed_again = NEVER, NEVER, [], -10_000_000
        self.claim_at, self.either_until = None, 0
        self.restart_by = NEVER
        self.due(0x18EEFF00, NAME)

    # Frames of the valve.

    def due(self, identifier, *answers, why="", within=BUS_US, at=None):
        at = self.now if at is None else at
        if identifier in (0x18EEFF00, 0x18FECA00, 0x18FECB00) or why == "AVEF":
            # One that still waits for the bus answers both, or is out of date.
            for waiting in self.expected:
                waiting.optional |= waiting.identifier == LONG | identifier | self.address and waiting.due + LATE_US >= self.free
        self.expected.append(Expected(at, LONG | identifier | self.address, *answers, within=within, why=why))

    def hear(self, now, identifier, data):
        if identifier == LONG | 0x18EEFF00 | self.address and self.claim_at is None:
            self.claim_at = now
        elif identifier == LONG | 0x18FECA00 | self.address and data[2:5] == SPOOL and self.now < self.changed + 700_000:
            raise Undecided
        elif identifier == LONG | 0x18FECA00 | self.address and len(data) == 8:
            for fault in list(self.kept):
                if data[2:5] == struct.pack("<I", CODES[fault][0])[:3]:
                    kept = self.kept.pop(fault)
                    self.counters[fault] = kept if data[5] == kept else self.counters[fault]
        elif identifier >> 8 == (LONG | 0x0CFE1000 | (self.address & 15) << 8) >> 8 and self.flow_due == NEVER:
            # The grid is what the first one shows: 250 ms after the claim.
            if not 249_000 < now - self.claim_at < 252_000:
                self.due(0x0CFE1000 | (self.address & 15) << 8, None, why=f"at 250 ms, not {now - self.claim_at}")
            self.now = now - 560
            self.flow()
            self.now = now

    def flow_data(self):
        position = self.position()
        if position is None:
            flows = [None, None]
        else:
            percent = scaled(position, 100, 16384)
            flows = [125 + max(percent, 0), 125 + max(-percent, 0)]
        return [*flows, 0x30 | self.state_now, *[0xFF] * 5]

    def flow(self, grid=True):
        answers = [self.flow_data()] + [[None] * 8] * (self.now < self.either_until)
        self.due(0x0CFE1000 | (self.address & 15) << 8, *answers, why="AVEF")
        if grid:
            self.flow_due = self.now + 100_000

    def highest(self):
        return next((fault for fault in CODES if fault in self.active), None)

    def dm1(self):
        fault = self.highest()
        code, lamp = CODES[fault] if fault else (0, 0)
        counts = [self.counters[fault], self.kept.get(fault, self.counters[fault])] if fault else [0]
        data = [bytes([lamp, 0xFF]) + struct.pack("<I", code | count << 24) + b"\xff\xff" for count in counts]
        self.due(0x18FECA00, *data, why="DM1")

    def dm1_event(self, before):
        if self.highest() != before:
            self.dm1()
            self.dm1_due = self.now + 1_000_000 if self.active else NEVER

    def dm1_again(self):
        self.dm1()
        self.dm1_due += 1_000_000

    # Faults.

    def activate(self, fault):
        before = self.highest()
        self.since.pop(fault, None)
        self.active.append(fault)
        self.counters[fault] = min(127, self.counters[fault] + 1)
        if fault in self.before_dm3 and self.now < self.dm3_until:
            # The page does not say whether DM3 acts when it is received or when the memory is written.
            self.kept[fault] = min(127, self.before_dm3[fault] + 1)
        if fault not in self.shut_down:
            self.shut_down.append(fault)
        if self.shutdown_at == NEVER:
            self.shutdown_at = self.now
            self.away_until = self.now if self.position() == 0 else self.now + SPRINGS_US
        self.neutral_count = 0
        self.act(BLOCKED, 0)
        self.dm1_event(before)

    def clear(self, fault):
        before = self.highest()
        self.active.remove(fault)
        self.dm1_event(before)

    def guard_ends(self):
        self.guard_from = NEVER
        self.activate("time-guarding")

    def send_packet(self):
        _, data = self.bam.pop(0)
        # 100 ms from the begin of the one before, or from its end: the page does not say.
        self.due(0x1CEBFF00, data, why="packet of DM2", within=2 * BUS_US)

    def timers(self):
        result = self.delays() + [(self.flow_due, self.flow), (self.dm1_due, self.dm1_again)]
        if self.guard_from < NEVER:
            result.append((self.guard_from + 250_000, self.guard_ends))
        if self.bam:
            result.append((self.bam[0][0], self.send_packet))
        return result

    def advance(self, now):
        while True:
            due, action = min([*self.timers(), (NEVER, None)], key=lambda timer: timer[0])
            if due > now:
                break
            self.now = max(due, self.now)
            action()
        self.now = max(now, self.now)

    # Position, known at rest alone.

    def act(self, state, set_point):
        if (state, set_point) != (self.state_now, self.set_point):
            self.either_flow(self.now - GRID_US)
            self.changed = self.now
        self.state_now, self.set_point = state, set_point

    def either_flow(self, since):
        self.either_until = self.now + GRID_US
        for due in self.expected:
            if due.why == "AVEF" and due.due > since:
                due.answers += ([None] * 8,)

    def position(self):
        if self.now < self.changed + 700_000:
            return None
        return 16384 if self.set_point == FLOAT else self.set_point

    # Frames to the valve.

    def receive(self, now, identifier, data):
        self.advance(now)
        if not identifier >> 31:
            return
        identifier &= LONG - 1
        source, target, pgn = identifier & 0xFF, identifier >> 8 & 0xFF, identifier >> 8 & 0x3FFFF
        if source == self.address and pgn >> 16 != 3 and pgn & ~0xFF != 0xEE00 and self.flow_due < NEVER:
            if now >= self.claimed_again + 5_000_000:
                self.claimed_again = now
                self.due(0x18EEFF00, NAME, why="claim: somebody uses the address")
        if pgn == 0xFE30 + (self.address & 15) and len(data) == 8:
            self.command(data)
        elif pgn & ~0xFF == 0xEA00 and target in (self.address, GLOBAL) and len(data) >= 3:
            self.request(source, target != GLOBAL, data[:3])
        elif pgn & ~0xFF == 0xEC00 and target == self.address and len(data) == 8 and data[0] == 16 and source < NULL:
            self.due(0x1CEC0000 | source << 8, b"\xff\x02\xff\xff\xff" + data[5:], why="connection abort")
        elif pgn & ~0xFF == 0xEE00 and source == self.address and len(data) == 8 and data != NAME:
            if int.from_bytes(data, "little") > int.from_bytes(NAME, "little"):
                self.due(0x18EEFF00, NAME, why="claim against a higher NAME")

    def command(self, data):
        flow, state, failsafe = data[0], data[2] & 15, data[2] >> 6
        if state not in WORDS or failsafe in (1, 2) or state in (EXTEND, RETRACT) and flow > 250:
            return
        # An AVEF that is due while this AVC is on the bus may be of either instant.
        self.either_flow(-NEVER)
        self.guard_from = self.now
        if "time-guarding" in self.active:
            self.clear("time-guarding")
        set_point = 0
        if state in (EXTEND, RETRACT):
            set_point = scaled(flow if state == EXTEND else -flow, 16384, 250)
            if self.kind == "pveo-isobus" and set_point:
                set_point = 16384 if state == EXTEND else -16384
        elif state == FLOATING:
            set_point = FLOAT
        if self.shut_down:
            neutral = state == BLOCKED or state in (EXTEND, RETRACT) and flow == 0
            if neutral and not self.active and self.now < self.away_until:
                raise Undecided
            self.neutral_count = self.neutral_count + 1 if neutral and not self.active else 0
            if self.neutral_count == 2:
                self.shut_down, self.shutdown_at, self.neutral_count = [], NEVER, 0
            return
        self.act(state, set_point)

    def previous(self):
        return [fault for fault in CODES if self.counters[fault] and fault not in self.active and fault not in self.shut_down]

    def request(self, source, addressed, pgn):
        number = int.from_bytes(pgn, "little")
        if number == 0xEE00:
            self.due(0x18EEFF00, NAME, why="claim on request")
        elif number == 0xFECA:
            self.dm1()
        elif number == 0xFE10 + (self.address & 15):
            self.flow(grid=False)
        elif number == 0xFECB:
            self.dm2()
        elif number == 0xFECC:
            previous = self.previous()
            self.before_dm3, self.dm3_until = {fault: self.counters[fault] for fault in previous}, self.now + MEMORY_US
            for fault in previous:
                self.counters[fault] = 0
                self.kept.pop(fault, None)
            if addressed and source < NULL:
                self.due(0x18E8FF00, bytes([0, 0xFF, 0xFF, 0xFF, source]) + pgn, why="DM3 done", within=MEMORY_US)
        elif addressed and source < NULL:
            self.due(0x18E8FF00, bytes([1, 0xFF, 0xFF, 0xFF, source]) + pgn, why="not supported")

    def dm2(self):
        if self.bam:
            return
        faults = self.previous()
        lamp = max([CODES[fault][1] for fault in faults], default=0)
        data = [lamp, 0xFF]
        for fault in faults:
            data += [*struct.pack("<I", CODES[fault][0])[:3], None if fault in self.kept else self.counters[fault]]
        if len(faults) < 2:
            self.due(0x18FECB00, (data + [0] * 4)[:6] + [0xFF] * 2, why="DM2")
            return
        packets = -(-len(data) // 7)
        self.due(0x1CECFF00, struct.pack("<BHBB", 0x20, len(data), packets, 0xFF) + b"\xcb\xfe\0", why="BAM of DM2")
        parts = [([i + 1] + data[7 * i : 7 * i + 7] + [0xFF] * 7)[:8] for i in range(packets)]
        self.bam = [(self.now + 100_000 * (i + 1), part) for i, part in enumerate(parts)]

    def state(self):
        return dict(node_id=self.address, command=WORDS[self.state_now])


class Traffic:
    """Steps for a valve on ISOBUS: a tractor that drives, and everybody else."""

    def __init__(self, run, dice):
        self.run, self.model, self.dice = run, run.model, dice
        self.what, self.since = (BLOCKED, 0), 0

    def next(self):
        dice = self.dice
        choice = dice.choices(("drive", "pause", "requests", "hostile", "plant", "recover", "state"), (20, 3, 12, 8, 3, 5, 3))[0]
        return getattr(self, choice)()

    def avc(self, state, flow, reserved=0x30):
        identifier = LONG | 0x0CFE3000 | (self.model.address & 15) << 8 | 0x27
        return identifier, bytes([flow, 0xFF, state | reserved, *[0xFF] * 5])

    def wait_for_the_spool(self):
        model = self.model
        return [("frames", [], 220)] if model.shut_down and model.now < model.shutdown_at + 200_000 else []

    def drive(self):
        dice, model = self.dice, self.model
        steps = self.wait_for_the_spool()
        if model.now > self.since + 700_000:
            new = (dice.choice((0, 1, 1, 2, 2, 3, 10, 14)), dice.choice((0, 1, 10, 125, 250)))
            if new != self.what:
                self.what, self.since = new, model.now
        return [*steps, ("cycle", self.avc(*self.what, dice.choice((0x30, 0x00, 0xC0))), dice.choice((20, 100, 100, 100, 200)), 5)]

    def recover(self):
        """Neutral AVCs, at times with one in between that is not: of a valve that is shut down, two in a row count."""
        self.what, self.since = (BLOCKED, 0), self.model.now
        steps = self.wait_for_the_spool()
        if self.model.shut_down and self.dice.random() < 0.5:
            words = [(BLOCKED, 0), (EXTEND, 125)] * self.dice.choice((1, 2))
            return steps + [("frames", [self.avc(*word)], 100) for word in words]
        return [*steps, ("cycle", self.avc(BLOCKED, 0), 100, self.dice.choice((1, 2, 8)))]

    def pause(self):
        return [("frames", [], self.dice.choice((50, 260, 1100, 2200)))]

    def requests(self):
        dice, address = self.dice, self.model.address
        frames = []
        for _ in range(dice.choice((1, 2, 5))):
            pgn = dice.choice((0xFECA, 0xFECB, 0xFECB, 0xFECC, 0xEE00, 0xFE10 + (address & 15), 0xFE11, 0xFEDA, dice.getrandbits(18)))
            target, source = dice.choice((address, address, GLOBAL, address ^ 1)), dice.choice((0x27, 0xF9, 0x05, 0xFE, 0xFF))
            data = struct.pack("<I", pgn)[: dice.choice((3, 3, 3, 3, 2))] + dice.choice((b"", b"", bytes(5)))
            frames.append((LONG | 0x18EA0000 | target << 8 | source, data[:8]))
            if pgn in (0xFECB, 0xFECC):
                break
        if frames[-1][1][:3] == b"\xcc\xfe\0":
            # An AVC before it: no time guard ends while the memory is written.
            return [*self.wait_for_the_spool(), ("frames", [self.avc(*self.what)], 2), ("frames", frames, 100)]
        return [("frames", frames, 500 if frames[-1][1][:3] == b"\xcb\xfe\0" else 10)]

    def hostile(self):
        dice, address = self.dice, self.model.address
        x = (address & 15) << 8
        higher = (int.from_bytes(NAME, "little") + 1).to_bytes(8, "little")
        identifier, data = dice.choice((
            (0x0CFE3027 | x, bytes([251, 0xFF, 0x31, *[0xFF] * 5])), (0x0CFE3027 | x, bytes([50, 0xFF, 0x34, *[0xFF] * 5])),
            (0x0CFE3027 | x, bytes([50, 0xFF, 0x71, *[0xFF] * 5])), (0x0CFE3027 | x, bytes([50, 0xFF, 0x31])),
            (0x0CFE3127 | x, bytes([50, 0xFF, 0x31, *[0xFF] * 5])), (0x18FEF100 | address, bytes(8)),
            (0x18EEFF00 | address, higher), (0x18EEFF00 | address, NAME), (0x18EEFF27, bytes(8)),
            (0x1CEC0027 | address << 8, bytes.fromhex("1009000202CAFE00")), (0x18EC00FE | address << 8, bytes.fromhex("1009000202CAFE00")),
            (0x1CECFF27, bytes.fromhex("20090002FFD8FE00")), (0x1CEBFF27, b"\x01" + NAME[:7]), (dice.getrandbits(29), dice.randbytes(8)),
        ))  # fmt: skip
        if identifier & 0xFF == address and identifier >> 8 & 0x3FF00 == 0xEA00 or identifier >> 26 & 1 and identifier >> 27 == 3:
            return []
        return [("frames", [(LONG | identifier, data)], dice.choice((3, 3, 20)))]

    def state(self):
        return [("state",)]

    def plant(self):
        return [("plant", self.dice.choice([
            *(dict(supply_mv=mv) for mv in (24000, 24000, 8000, 40000, 10000)), *(dict(temperature_c=c) for c in (25, 25, 130, 118, -50)),
            *(dict(internal_fault=on) for on in (True, False, False)),
        ]))]  # fmt: skip


Valve.traffic = Traffic
