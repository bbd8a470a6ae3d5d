"""A plain model of PVEA-CI and PVEO-CI on CANopen, and of what acts on a valve from outside."""

import struct

from canopen import (
    NEVER, NOT_ALLOWED, TOO_HIGH, TOO_LOW, NOT_MAPPABLE, PDO_TOO_LONG, SIGNATURE, PDO_IS_ON, SAVE,
    LOAD, CLEAR, MEMORY_US, STOPPED, OPERATIONAL, PRE_OPERATIONAL, Abort, Node, Undecided, scaled, restricted,
)  # fmt: skip

RPDO, TPDO = 0x1400, 0x1800
MAPPABLE = {
    0x1400: {0x60400010, 0x33000008, 0x33030010, 0x60420008, 0x63000110},
    0x1800: {0x60410010, 0x33010008, 0x33020008, 0x33040010, 0x63010110},
}
DUMMIES = {1: 1, 2: 8, 3: 16, 4: 32, 5: 8, 6: 16, 7: 32}
STATUS = {"init": 0x08, "disabled": 0x09, "hold": 0x0B, "active": 0x0F, "fault-hold": 0x03}
FLOAT = 32767

# name: (EMCY code, own bits of the error register, delay in us, object of the counter), by priority
FAULTS = {
    "spool": (0x8305, 0x21, 500_000, 0x201D),
    "internal": (0x1000, 0x01, 0, 0x2024),
    "can-bus": (0x8140, 0x11, 0, 0x2019),
    "temperature": (0x8301, 0x09, 250_000, 0x200F),
    "supply-high": (0x3411, 0x05, 2_000_000, 0x2001),
    "supply-low": (0x3412, 0x05, 2_000_000, 0x2002),
    "time-guarding": (0x8003, 0x91, 250_000, 0x2023),
}


class Causes:
    """What acts on a valve from outside, and the delays until that is a fault."""

    coldest = -40

    def look_at_plant(self):
        supply, temperature = self.plant["supply_mv"], self.plant["temperature_c"]
        for fault, trips, clears in (
            ("internal", self.plant["internal_fault"], not self.plant["internal_fault"]),
            ("temperature", temperature > 120 or temperature < self.coldest,
             self.coldest + 5 < temperature < 115),
            ("supply-high", supply > 36000, supply < 32000),
            ("supply-low", supply < 9000, supply > 11000),
        ):
            if fault in self.active:
                if clears:
                    self.clear(fault)
            elif not trips:
                self.since.pop(fault, None)
            else:
                self.since.setdefault(fault, self.now)

    def set_plant(self, now, changes):
        self.advance(now)
        self.plant.update(changes)
        self.look_at_plant()

    def delays(self):
        return [(since + FAULTS[fault][2], lambda fault=fault: self.activate(fault)) for fault, since in self.since.items()]


def mappable(pdo, entry):
    if entry in MAPPABLE[pdo]:
        return True
    index, sub, bits = entry >> 16, entry >> 8 & 0xFF, entry & 0xFF
    return sub == 0 and DUMMIES.get(index) == bits


class Valve(Causes, Node):
    """PVEA-CI and PVEO-CI Series 6 on CANopen."""

    identity = (0x01000019, 0x53360000, 0x00010020, 0x5B2E0100)
    bit_rates, default_rate, default_node = (2, 3, 4), 3, 0x20

    def __init__(self, kind, node=None):
        self.kind = kind
        self.counters = dict.fromkeys(FAULTS, 0)
        self.saved = None
        self.restore = False
        self.plant = dict(supply_mv=24000, temperature_c=25, internal_fault=False)
        self.since = {}
        self.stuck, self.deviates = False, (None, 0)
        super().__init__(node or self.default_node)

    def defaults(self):
        values = {(0x1005, 0): 0x80, (0x1017, 0): 0, (0x1028, 1): 0x80000000,
                  (0x1400, 1): 0x200 + self.node, (0x1400, 2): 0xFF, (0x1800, 1): 0x180 + self.node, (0x1800, 2): 0xFF,
                  (0x1600, 0): 2, (0x1A00, 0): 2,
                  (0x6053, 0): b"PVEA-CI S6" if self.kind == "pvea-canopen" else b"PVEO-CI S6"}  # fmt: skip
        for index, entries in ((0x1600, (0x60400010, 0x63000110)), (0x1A00, (0x60410010, 0x63010110))):
            for sub in range(1, 9):
                values[index, sub] = entries[sub - 1] if sub < 3 else 0x00010001
        return values

    # Starts.

    def power_up(self):
        self.held = None
        self.mode, self.set_point, self.control, self.dsm = 1, 0, 0, "init"
        self.acting = 0
        self.history, self.active, self.since = [], [], {}
        self.half_way, self.deviates = False, (None, 0)
        self.guard_from, self.heartbeat_due, self.transfer = NEVER, NEVER, None
        self.moving_until = self.now + 1_000_000
        self.start()

    def start(self):
        """A start of the page: power-up, reset application, restart under a new node ID."""
        self.node = self.held if self.held is not None else self.stored_node
        self.rate = self.stored_rate
        if self.restore:
            self.restore = False
            self.saved = self.defaults()
        self.pending_node = self.pending_rate = None
        self.load()
        self.boot()
        self.expect(0x80 + self.node, bytes(8), why="reset EMCY")
        self.look_at_plant()

    def load(self):
        self.values = dict(self.saved) if self.saved is not None else self.defaults()
        self.sync_count = 0

    def reset_application(self):
        self.mode, self.set_point, self.control, self.dsm = 1, 0, 0, "init"
        self.acting = 0
        self.history, self.active, self.since = [], [], {}
        self.half_way = False
        self.guard_from, self.deviates = NEVER, (None, 0)
        self.settle()
        self.start()

    def reset_communication(self):
        if self.pending_node is not None:
            self.held = self.pending_node
        self.node = self.held if self.held is not None else self.stored_node
        self.pending_node = self.pending_rate = None
        self.hold_fault()
        self.half_way = False
        description = self.values[0x6053, 0]
        self.load()
        # CiA 301: reset communication loads 0x1000 to 0x1FFF.
        self.values[0x6053, 0] = description
        self.boot()
        self.expect(0x80 + self.node, bytes(8), why="reset EMCY")
        for fault in FAULTS:
            if fault in self.active:
                self.emergency(fault)

    def entered(self, before):
        if self.nmt == STOPPED:
            self.half_way = False
            self.hold_fault()
        if self.nmt == OPERATIONAL:
            self.sync_count = 0

    def leave_configuration(self):
        super().leave_configuration()
        self.pending_node = self.pending_rate = None

    def heartbeat_time(self):
        return self.values[0x1017, 0]

    def heartbeat_period(self, milliseconds):
        return -(-milliseconds // 10) * 10

    def hear(self, now, identifier, data):
        super().hear(now, identifier, data)
        if identifier == 0x80 + self.node and data[:2] == b"\x05\x83" and self.position() is None:
            raise Undecided

    # Faults.

    def settle(self):
        self.moving_until = self.now + 1_000_000

    def hold_fault(self):
        self.half_way = False
        self.dsm = "fault-hold"
        self.guard_from = NEVER
        self.deviates = (None, 0)
        self.settle()

    def register(self):
        result = 0
        for fault in self.active:
            result |= FAULTS[fault][1]
        return result

    def emergency(self, fault):
        code, _, _, _ = FAULTS[fault]
        # One that falls into a restart is told after the boot-up.
        if self.nmt in (PRE_OPERATIONAL, OPERATIONAL) and self.restarting is None:
            self.expect(0x80 + self.node, struct.pack("<HBB4x", code, self.register(), self.counters[fault]), why=fault)

    def activate(self, fault):
        self.since.pop(fault, None)
        self.active.append(fault)
        self.counters[fault] = min(127, self.counters[fault] + 1)
        self.history = [FAULTS[fault][0] | self.counters[fault] << 16, *self.history][:8]
        self.emergency(fault)
        self.hold_fault()
        if self.nmt == OPERATIONAL and any(due.why.startswith("TPDO") for due in self.expected):
            self.may_send_tpdo()

    def clear(self, fault):
        self.active.remove(fault)
        if not self.active and self.nmt in (PRE_OPERATIONAL, OPERATIONAL):
            self.expect(0x80 + self.node, bytes(8), why="no fault any more")

    def timers(self):
        result = super().timers() + self.delays()
        if self.guard_from < NEVER:
            result.append((self.guard_from + 250_000, self.guard_ends))
        if self.deviates[0]:
            result.append((sum(self.deviates), self.spool_deviated))
        return result

    def guard_ends(self):
        self.guard_from = NEVER
        self.activate("time-guarding")

    # A spool that is stuck, always in neutral: a healthy one deviates for less than the delays.

    def set_plant(self, now, changes):
        super().set_plant(now, changes)
        if "spool" in changes:
            self.stuck = changes["spool"]["fault"] == "stuck"
            self.watch()

    def watch(self):
        """Starts or ends the delay of the spool's monitors."""
        deviation = None
        if self.stuck and self.dsm == "active" and self.mode == 1:
            if self.acting == FLOAT:
                deviation = 1_000_000
            elif abs(self.target()) > 16384 * 15 // 100:
                deviation = 500_000
        if deviation != self.deviates[0]:
            self.deviates = (deviation, self.now)

    def spool_deviated(self):
        self.deviates = (None, 0)
        self.activate("spool")
        # It stands in neutral: the cause is gone at once.
        self.clear("spool")

    # The device state machine.

    def take_mode(self, mode):
        if mode == self.mode:
            return
        self.mode = mode
        if self.dsm == "active":
            self.enter_active()

    def enter_active(self):
        self.guard_from = self.now if self.mode == 1 else NEVER
        self.acting = 0
        self.settle()
        self.deviates = (None, 0)
        self.watch()

    def take_control(self, word):
        self.control = word
        bits, before = word & 0xF, self.dsm
        held, self.half_way = self.half_way, False
        if self.dsm == "init" and bits & 1:
            self.dsm = "disabled"
        elif self.dsm == "disabled" and bits & 3 == 3:
            self.dsm = "hold"
        elif self.dsm == "disabled" and bits & 7 == 0:
            self.dsm = "init"
        elif self.dsm == "hold" and bits & 7 == 7:
            self.dsm = "active"
            self.enter_active()
        elif self.dsm == "hold" and bits & 6 == 0:
            self.dsm = "disabled"
        elif self.dsm == "active" and not bits & 4:
            self.dsm = "hold"
            self.guard_from = NEVER
        elif self.dsm == "fault-hold":
            if bits == 3:
                self.half_way = True
            elif bits == 0xB and held and not self.active:
                self.dsm = "hold"
        if before != self.dsm:
            self.settle()
        self.watch()

    def take_set_point(self, value):
        self.set_point = value
        if self.guard_from < NEVER:
            self.guard_from = self.now
        if self.dsm == "active" and self.mode == 1 and self.acting != value:
            self.acting = value
            self.settle()
            self.watch()
        if "time-guarding" in self.active:
            self.clear("time-guarding")

    def position(self):
        """Returns where the spool stands, or None while it moves."""
        if self.stuck:
            return 0
        if self.now < self.moving_until:
            return None
        if self.dsm != "active" or self.mode != 1:
            return 0
        return self.target()

    def target(self):
        if self.kind == "pveo-canopen" and self.acting != FLOAT:
            return 16384 * ((self.acting > 0) - (self.acting < 0))
        return self.acting

    def actual(self, to):
        position = self.position()
        if position is None:
            return None
        if position == FLOAT:
            return FLOAT if to == 16384 else to
        return scaled(position, to, 16384)

    # PDOs and everything else that is received.

    def other(self, identifier, data):
        values = self.values
        producer = values[0x1028, 1]
        if not producer >> 31 and identifier == producer & 0x7FF:
            stop = len(data) == 8 and data[:2] == b"\0\x10"
            if stop and self.dsm == "active" and self.nmt in (PRE_OPERATIONAL, OPERATIONAL):
                self.hold_fault()
            return
        if self.nmt != OPERATIONAL:
            return
        rpdo = values[0x1400, 1]
        if not rpdo >> 31 and identifier == rpdo & 0x7FF:
            self.rpdo(data)
        elif identifier == values[0x1005, 0] & 0x7FF:
            kind = values[0x1800, 2]
            if kind != 0xFF:
                self.sync_count += 1
                if self.sync_count % kind == 0:
                    # Of one that still waits at the next SYNC, page and manual say nothing, and CiA 301 only with a 0x1007.
                    self.merge("TPDO")
                    self.tpdo()

    def entries(self, index):
        return [self.values[index, sub] for sub in range(1, self.values[index, 0] + 1)]

    def rpdo(self, data):
        entries = self.entries(0x1600)
        if len(data) * 8 < sum(entry & 0xFF for entry in entries):
            return
        bits = int.from_bytes(data, "little")
        mode = control = set_point = None  # the last valid ones
        for entry in entries:
            size = entry & 0xFF
            value, bits = bits & (1 << size) - 1, bits >> size
            if entry == 0x60420008:
                mode = value if value in (1, 2) else mode
            elif entry == 0x60400010:
                control = value
            elif entry >> 16 in (0x6300, 0x3300, 0x3303):
                value -= (value >> size - 1) << size
                try:
                    set_point = self.checked_set_point(entry >> 16, value)
                except Abort:
                    pass
        if mode is not None:
            self.take_mode(mode)
        if control is not None:
            self.take_control(control)
        if set_point is not None:
            self.take_set_point(set_point)
        if self.values[0x1800, 2] == 0xFF:
            self.merge("TPDO")
            self.tpdo()

    def tpdo(self):
        if self.values[0x1800, 1] >> 31:
            return
        bits, known, at = 0, 0, 0
        for entry in self.entries(0x1A00):
            size = entry & 0xFF
            value = {0x6041: lambda: STATUS[self.dsm], 0x3301: lambda: self.actual(127),
                     0x3302: lambda: None if self.actual(127) is None else -self.actual(127),
                     0x3304: lambda: self.actual(1000), 0x6301: lambda: self.actual(16384)}.get(entry >> 16, lambda: 0)()  # fmt: skip
            if value is not None:
                bits |= (value & (1 << size) - 1) << at
                known |= (1 << size) - 1 << at
            at += size
        known |= -1 << at  # fill bits are 0
        data = [bits >> 8 * i & 0xFF if known >> 8 * i & 0xFF == 0xFF else None for i in range((at + 7) // 8)]
        self.expect(self.values[0x1800, 1] & 0x7FF, data, why=f"TPDO, {self.dsm}")

    # Objects.

    def objects(self, index):
        v = self.values
        names = {0x2001: "supply-high", 0x2002: "supply-low", 0x200F: "temperature", 0x2019: "can-bus", 0x201D: "spool",
                 0x2023: "time-guarding", 0x2024: "internal", 0x2040: "internal"}  # fmt: skip
        if index in names:
            return {0: ("U8", "ro", self.counters[names[index]])}
        if index in (0x1600, 0x1A00):
            return {sub: ("U8" if sub == 0 else "U32", "rw", v[index, sub]) for sub in range(9)}
        if index in (0x1400, 0x1800):
            return {0: ("U8", "ro", 2), 1: ("U32", "rw", v[index, 1]), 2: ("U8", "rw", v[index, 2])}
        part = 11149437 if self.kind == "pvea-canopen" else 11149443
        actual = {0x3301: ("I8", 127, 1), 0x3302: ("I8", 127, -1), 0x3304: ("I16", 1000, 1), 0x6301: ("I16", 16384, 1)}
        if index in actual:
            kind, to, sign = actual[index]
            value = self.actual(to)
            leaf = (kind, "ro", None if value is None else sign * value)
            return {0: ("U8", "ro", 1), 1: leaf} if index == 0x6301 else {0: leaf}
        float_or = lambda to: to if self.set_point == FLOAT else scaled(self.set_point, to, 16384)  # noqa: E731
        simple = {
            0x1000: ("U32", "ro", 0x198), 0x1001: ("U8", "ro", self.register()), 0x1005: ("U32", "rw", v[0x1005, 0]),
            0x100A: ("VSTR", "ro", b"APP-_S6m1_M_R132_CANOPEN-_%d_-000_ 180701" % part),
            0x1014: ("U32", "ro", self.node + 0x80), 0x1017: ("U16", "rw", v[0x1017, 0]),
            0x3300: ("I8", "rw", float_or(127)), 0x3303: ("I16", "rw", float_or(1000)),
            0x6040: ("U16", "rw", self.control), 0x6041: ("U16", "ro", STATUS[self.dsm]), 0x6042: ("I8", "rw", self.mode),
            0x6052: ("VSTR", "ro", str(self.identity[3]).encode()), 0x6053: ("VSTR", "rw", v[0x6053, 0]),
            0x605F: ("U32", "ro", 0x05000000),
        }  # fmt: skip
        if index in simple:
            return {0: simple[index]}
        return {
            0x1003: {0: ("U8", "rw", len(self.history)), **{i + 1: ("U32", "ro", e) for i, e in enumerate(self.history)}},
            0x1010: {0: ("U8", "ro", 1), 1: ("U32", "rw", 1)},
            0x1011: {0: ("U8", "ro", 5), 1: ("U32", "rw", 1), 5: ("U32", "rw", 1)},
            0x1018: {0: ("U8", "ro", 3), **{i + 1: ("U32", "ro", n) for i, n in enumerate(self.identity)}},
            0x1028: {0: ("U8", "ro", 1), 1: ("U32", "rw", v[0x1028, 1])},
            0x6300: {0: ("U8", "ro", 1), 1: ("I16", "rw", self.set_point)},
        }.get(index)

    def checked_set_point(self, index, value):
        top = {0x6300: 16384, 0x3300: 127, 0x3303: 1000}[index]
        if index == 0x6300 and value == FLOAT:
            return FLOAT
        if value > top:
            raise Abort(TOO_HIGH)
        if value < -top:
            raise Abort(TOO_LOW)
        return scaled(value, 16384, top)

    def store(self, index, sub, value):
        v = self.values
        if index == 0x1003:
            if value != 0:
                raise Abort(NOT_ALLOWED)
            self.history = []
        elif index == 0x1010:
            if value != SAVE:
                raise Abort(SIGNATURE)
            self.saved = dict(v)
            return MEMORY_US
        elif index == 0x1011:
            if value != (LOAD if sub == 1 else CLEAR):
                raise Abort(SIGNATURE)
            if sub == 1:
                self.restore = True
            else:
                self.counters = dict.fromkeys(FAULTS, 0)
            return MEMORY_US
        elif index == 0x1017:
            if value > 0x7FFF:
                raise Abort(TOO_HIGH)
            v[index, 0] = value
            self.set_heartbeat(value)
        elif index in (0x1005, 0x1028):
            if not (index == 0x1028 and value >> 31):
                if value & 0x3FFFF800 or restricted(value & 0x7FF) or index == 0x1005 and value >> 30 & 1:
                    raise Abort(NOT_ALLOWED)
            v[index, sub] = value
        elif index in (0x1600, 0x1A00):
            self.store_mapping(index, sub, value)
        elif index in (0x1400, 0x1800):
            if sub == 1:
                self.store_cob_id(index, value)
            elif value != 0xFF and (index == RPDO or not 1 <= value <= 240):
                raise Abort(NOT_ALLOWED)
            else:
                v[index, 2] = value
                if index == TPDO:
                    self.sync_count = 0
        elif index in (0x6300, 0x3300, 0x3303):
            self.take_set_point(self.checked_set_point(index, value))
            self.may_repeat()
        elif index == 0x6040:
            self.take_control(value)
            self.may_repeat()
        elif index == 0x6042:
            if value not in (1, 2):
                raise Abort(NOT_ALLOWED)
            self.take_mode(value)
            self.may_repeat()
        else:
            v[index, sub] = value
            self.may_repeat()
        return None

    def may_repeat(self):
        """While a heartbeat waits for the bus, the device cannot know that its TPDO does not: a write may repeat it."""
        if any(due.why == "heartbeat" for due in self.expected):
            self.may_send_tpdo()

    def may_send_tpdo(self):
        before = len(self.expected)
        self.tpdo()
        for due in self.expected[before:]:
            due.optional = True

    def store_mapping(self, index, sub, value):
        v, pdo = self.values, index - 0x200
        on = not v[pdo, 1] >> 31
        wrong = []
        if value == v[index, sub]:
            return
        if on:
            wrong.append(PDO_IS_ON)
        if sub == 0:
            wrong += [PDO_TOO_LONG] if value > 8 else self.mapping_faults(index, value)
        elif value == 0:
            wrong += [NOT_MAPPABLE] if sub <= v[index, 0] else []
        elif not mappable(pdo, value):
            wrong.append(NOT_MAPPABLE)
        if wrong:
            raise Abort(*wrong)
        v[index, sub] = value

    def mapping_faults(self, index, count):
        entries = [self.values[index, sub] for sub in range(1, count + 1)]
        result = [PDO_TOO_LONG] if sum(entry & 0xFF for entry in entries) > 64 else []
        return result + ([NOT_MAPPABLE] if 0 in entries else [])

    def store_cob_id(self, index, value):
        v = self.values
        before = v[index, 1]
        if value == before:
            return
        if value >> 31:
            v[index, 1] = value
            return
        wrong = []
        if value & 0x3FFFF800 or restricted(value & 0x7FF):
            wrong.append(NOT_ALLOWED)
        if before >> 31:
            entries = self.entries(index + 0x200)
            if sum(entry & 0xFF for entry in entries) > 64:
                wrong.append(PDO_TOO_LONG)
            if not entries or 0 in entries:
                wrong += [NOT_ALLOWED, NOT_MAPPABLE][: 1 + (0 in entries)]
        elif (value ^ before) & ~0x40000000:
            wrong.append(PDO_IS_ON)
        if wrong:
            raise Abort(*wrong)
        v[index, 1] = value
        if before >> 31 and index == TPDO:
            self.sync_count = 0

    # LSS.

    def lss_node(self, node):
        if not 1 <= node <= 127:
            return 1
        self.pending_node = node
        return 0

    def lss_store(self):
        configured = self.held if self.pending_node is None else self.pending_node
        if configured is not None:
            self.stored_node = configured
            self.held = None if self.held is None else configured
        if self.pending_rate is not None:
            self.stored_rate = self.pending_rate

    def lss_waiting(self):
        if self.pending_node is not None and self.pending_node != self.node:
            self.held = self.pending_node
            self.restart(self.reset_application)

    # What is worth trying.

    indices = [0x1000, 0x1001, 0x1003, 0x1005, 0x100A, 0x1010, 0x1011, 0x1014, 0x1017, 0x1018, 0x1028, 0x1400, 0x1600, 0x1800,
               0x1A00, 0x2001, 0x2002, 0x200F, 0x2019, 0x201D, 0x2023, 0x2024, 0x2040, 0x3300, 0x3301, 0x3302, 0x3303, 0x3304,
               0x6040, 0x6041, 0x6042, 0x6052, 0x6053, 0x605F, 0x6300, 0x6301]  # fmt: skip
    pdos = (0x1400, 0x1800)
    memory_commands = [(0x1010, 1, SAVE), (0x1011, 1, LOAD), (0x1011, 5, CLEAR)]
    plants = [dict(supply_mv=mv) for mv in (24000, 24000, 8000, 40000, 10000, 33000)] + [
        dict(temperature_c=c) for c in (25, 25, 130, 118, -50)] + [dict(internal_fault=on) for on in (True, False, False)]  # fmt: skip

    def is_text(self, index):
        return index in (0x100A, 0x6052, 0x6053)

    def worth(self, index, sub, dice):
        """Returns values worth writing to an object."""
        if index in (0x1600, 0x1A00) and sub:
            return [*MAPPABLE[index - 0x200], *(i << 16 | bits for i, bits in DUMMIES.items()), 0, 0x63000108,
                    0x60400010, 0x60410010, 0x10000020, self.values.get((index, sub), 0)]  # fmt: skip
        return {
            0x1003: [0, 0, 1], 0x1017: [0, 0, 1, 9, 10, 95, 100, 1000, 0x7FFF, 0x8000],
            0x1005: [0x80, 0x80, 0xC5, 0x100, 0x40000080, 0x20000080, 0x181, 0x7F, 0x880],
            0x1028: [0x80000000, 0xC5, 0x1A1, 0x333, 0x400000C5, 0x200000C5, 0x7F, 0x880],
            0x1400: [0xFF, 0xFE, 1] if sub == 2 else [0x80000220, 0x80000000, 0x220, 0x40000220, 0x2A0, 0x20000220, 0x7F, 0x601],
            0x1800: [0xFF, 1, 2, 3, 240, 241, 0, 0xFE] if sub == 2 else [0x800001A0, 0x80000000, 0x1A0, 0x400001A0, 0x1F0,
                                                                         0x200001A0, 0x7F, 0x601],
            0x1600: [0, 1, 2, 2, 3, 8, 9], 0x1A00: [0, 1, 2, 2, 3, 8, 9],
            0x3300: [0, 50, -50, 127, -127, -128], 0x3303: [0, 333, -333, 1000, -1000, 1001, -1001],
            0x6300: [0, 1, 5000, -5000, 16384, -16384, 16385, -16385, FLOAT, 32766, -32768],
            0x6040: [0, 1, 3, 11, 15, 15, 15, 7, 0xFFF3, 8], 0x6042: [1, 1, 2, 0, 3],
        }.get(index, [dice.getrandbits(32)])  # fmt: skip

    def state(self):
        nmt = {PRE_OPERATIONAL: "pre-operational", OPERATIONAL: "operational", STOPPED: "stopped"}[self.nmt]
        return dict(node_id=self.node, nmt=nmt, dsm=self.dsm, set_point="float" if self.set_point == FLOAT else self.set_point)
