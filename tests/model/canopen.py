"""The services that all CANopen devices share, as a plain model written from docs/behaviour.md, the manuals and the CiA standards."""

import struct

NEVER = 1 << 62
READ_ONLY, NO_OBJECT, NO_SUB = 0x06010002, 0x06020000, 0x06090011
MISMATCH, TOO_LONG, TOO_SHORT = 0x06070010, 0x06070012, 0x06070013
NOT_ALLOWED, TOO_HIGH, TOO_LOW = 0x06090030, 0x06090031, 0x06090032
NOT_MAPPABLE, PDO_TOO_LONG = 0x06040041, 0x06040042
TOGGLE, TIMEOUT, UNKNOWN = 0x05030000, 0x05040000, 0x05040001
SIGNATURE, PDO_IS_ON, NO_ENTRY, MEMORY = 0x08000020, 0x08000022, 0x08000024, 0x06060000
SIZES = {"U8": 1, "I8": 1, "U16": 2, "I16": 2, "U32": 4, "I32": 4}
SAVE, LOAD, CLEAR = 0x65766173, 0x64616F6C, 0x73646B70
# The longest time that the simulated memory takes for an answer, and a frame for its way to the bus.
MEMORY_US, BUS_US = 400_000, 20_000
#: A bus that is free for longer than this was free when a frame could have begun.
FREE_US = 50
#: The longest time from the instant at which a frame is due until it begins on a free bus.
LATE_US = 300
#: How many EMCYs wait for the bus at the most: the oldest are dropped.
EMERGENCIES = 16
INITIALISING, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0, 4, 5, 0x7F


class Undecided(Exception):
    """What depends on a moving spool, which the model has not: whether it is in neutral yet, how long it was behind."""


class Abort(Exception):
    """The codes that an SDO server may abort with: several where page and standard leave the choice."""

    def __init__(self, *codes):
        super().__init__(*codes)
        self.codes = codes


def written(identifier, data):
    """Writes a frame as the manual does."""
    name = f"{identifier & 0x1FFFFFFF:08X}" if identifier >> 31 else f"{identifier:03X}"
    return f"{name}: " + " ".join("__" if byte is None else f"{byte:02X}" for byte in data)


class Expected:
    """A frame that is due: `answers` are the data that are right, None in them for a byte that is not known."""

    def __init__(self, due, identifier, *answers, within=BUS_US, why=""):
        self.due, self.identifier, self.answers, self.within, self.why = due, identifier, answers, within, why
        self.optional = False

    def matches(self, data):
        return any(
            len(answer) == len(data) and all(e is None or e == g for e, g in zip(answer, data)) for answer in self.answers
        )

    def __str__(self):
        right = " or ".join(written(self.identifier, answer) for answer in self.answers)
        return f"{right} {self.why}, due at {self.due / 1000:.3f} ms"


def number(kind, data):
    return int.from_bytes(data, "little", signed=kind.startswith("I"))


def octets(kind, value):
    if kind == "VSTR":
        return value
    return (value & (1 << 8 * SIZES[kind]) - 1).to_bytes(SIZES[kind], "little")


def scaled(value, to, of):
    """value * to / of, rounded half away from zero."""
    magnitude = (2 * abs(value) * to + of) // (2 * of)
    return magnitude if value >= 0 else -magnitude


def longest(identifier, data):
    """Returns the bits that a frame takes at the most, with all that may be stuffed and the intermission."""
    fixed, stuffed = (67, 54) if identifier >> 31 else (47, 34)
    return fixed + 8 * len(data) + (stuffed + 8 * len(data) - 1) // 4


def restricted(identifier):
    return any(
        low <= identifier <= high
        for low, high in ((0, 0x7F), (0x101, 0x180), (0x581, 0x5FF), (0x601, 0x67F), (0x6E0, 0x6FF), (0x701, 0x7FF))
    )


class Sender:
    """What waits for the bus, and for how long nothing but the bus can have held it back."""

    bit_us = 4
    # The ends of the last frame, and of the last time at which the bus was free for certain.
    frame_end = free = 0

    def occupied(self, now, identifier, data, destroyed):
        """Looks at a frame of the bus, at its end, before the time until then has passed. Others may have been destroyed before it."""
        begin = now - longest(identifier, data) * self.bit_us
        if begin > self.frame_end + FREE_US and not destroyed:
            self.free = begin
        self.frame_end = now

    def late(self, due):
        """Tells of a frame that nothing held back."""
        return not due.optional and due.within <= BUS_US and due.due + LATE_US < self.free

    def merge(self, why):
        """A frame for which the bus was never free may give way to its successor, or be sent as well."""
        for due in self.expected:
            due.optional |= due.why.startswith(why) and due.due + LATE_US >= self.free


class Node(Sender):
    """The services that valves and sensors share: SDO server, NMT, heartbeat, LSS."""

    identity = ()
    bit_rates = ()

    def __init__(self, node):
        self.now = 0
        self.expected = []
        self.restarting, self.restart_by = None, NEVER
        self.stored_node, self.stored_rate = node, self.default_rate
        self.node, self.rate, self.held = node, self.default_rate, None
        self.lss_rate_known = False
        self.power_up()

    # Time and frames.

    def expect(self, identifier, *answers, within=BUS_US, why=""):
        emergencies = [e for e in self.expected if e.identifier == identifier and not e.optional and 0x81 <= identifier & 0x7FF <= 0xFF]
        if len(emergencies) >= EMERGENCIES:
            emergencies[0].optional = True
        self.expected.append(Expected(self.now, identifier, *answers, within=within, why=why))

    def timers(self):
        """Returns `(instant, action)` of everything that will happen by itself."""
        result = []
        if self.heartbeat_due < NEVER:
            result.append((self.heartbeat_due, self.beat))
        if self.transfer is not None:
            result.append((self.transfer["until"], self.transfer_ends))
        return result

    def advance(self, now):
        while True:
            due, action = min(self.timers() + [(NEVER, None)], key=lambda timer: timer[0])
            if due > now:
                break
            self.now = max(due, self.now)
            action()
        self.now = now

    def restart(self, action):
        """A restart waits for the memory: it happens when the device tells so by its boot-up."""
        self.restarting, self.restart_by = action, self.now + MEMORY_US
        self.heartbeat_due, self.transfer = NEVER, None
        self.waiting_may_go()

    def power_cut(self, now):
        self.advance(now)
        self.expected, self.held = [], None
        self.since, self.guard_from, self.deviates = {}, NEVER, (None, 0)
        self.nmt = INITIALISING
        self.restart(self.power_up)

    def hear(self, now, identifier, data):
        """Looks at a frame of the device for what the model cannot know: the end of a restart."""
        if identifier == 0x580 + self.node and data[0] == 0x80 and self.transfer is not None and self.transfer.get("too_long"):
            self.transfer = None
        if self.restarting is not None and 0x701 <= identifier <= 0x77F and data == b"\0":
            action, self.restarting, self.restart_by = self.restarting, None, NEVER
            self.now = now - 300  # the boot-up's way
            action()

    def receive(self, now, identifier, data):
        self.advance(now)
        if self.restarting is not None:
            return
        if identifier == 0 and len(data) == 2 and self.nmt != INITIALISING:
            if data[1] in (0, self.node):
                self.command(data[0])
        elif identifier == 0x7E5 and len(data) == 8 and self.nmt != OPERATIONAL:
            self.lss(data)
        elif self.nmt in (PRE_OPERATIONAL, OPERATIONAL) and identifier == 0x600 + self.node and len(data) == 8:
            self.sdo(data)
        else:
            self.other(identifier, data)

    # NMT and heartbeat.

    def command(self, command):
        if command == 1:
            self.enter(OPERATIONAL)
        elif command == 2:
            self.enter(STOPPED)
        elif command == 0x80:
            self.enter(PRE_OPERATIONAL)
        elif command == 0x81:
            self.restart(self.reset_application)
        elif command == 0x82:
            self.restart(self.reset_communication)

    def enter(self, state):
        before, self.nmt = self.nmt, state
        waiting = [due for due in self.expected if due.why == "heartbeat"]
        for due in waiting:
            # Already on the bus with the old state, or sent with the new one, or both.
            due.answers += (bytes([state]),)
            self.expect(due.identifier, bytes([state]), why="heartbeat")
            self.expected[-1].optional = True
        if state == STOPPED:
            self.transfer = None
            for due in self.expected:
                due.optional = True
        if state == OPERATIONAL:
            self.leave_configuration()
        if before != state:
            self.entered(before)

    def boot(self):
        self.transfer = None
        self.nmt = PRE_OPERATIONAL
        self.lss_state, self.lss_seen, self.lss_position = "waiting", [], 0
        self.expect(0x700 + self.node, b"\0", why="boot-up")
        self.boot_at = self.now
        self.heartbeat_due = NEVER
        self.set_heartbeat(self.heartbeat_time(), first=False)

    def set_heartbeat(self, milliseconds, first=True):
        self.waiting_may_go()
        period = self.heartbeat_period(milliseconds) * 1000
        if period == 0:
            self.heartbeat_due = NEVER
        else:
            self.heartbeat_due = self.now if first else self.now + period

    def heartbeat_period(self, milliseconds):
        return milliseconds

    def beat(self):
        # The page does not say how many of the heartbeats that wait for the bus are sent.
        self.merge("heartbeat")
        self.expect(0x700 + self.node, bytes([self.nmt]), why="heartbeat")
        self.heartbeat_due += self.heartbeat_period(self.heartbeat_time()) * 1000

    def waiting_may_go(self, *whys):
        """What waits for the bus while its producer changes may be sent or not."""
        for due in self.expected:
            due.optional |= due.why in (whys or ("heartbeat",))

    # SDO server. `self.objects` gives (type, access, value) by sub-index; `self.store` writes or raises Abort.

    def entry(self, index, sub):
        subs = self.objects(index)
        if subs is None:
            raise Abort(NO_OBJECT)
        if index == 0x1003 and 1 <= sub <= 8 and sub > len(self.history):
            return "U32", "absent", None
        if sub not in subs:
            raise Abort(NO_SUB)
        return subs[sub]

    def answer(self, data, **more):
        self.expect(0x580 + self.node, data.ljust(8, b"\0"), **more)

    def abort(self, mux, *codes, **more):
        self.transfer = None
        self.expect(0x580 + self.node, *[b"\x80" + mux + struct.pack("<I", code) for code in codes], **more)

    def transfer_ends(self):
        self.abort(self.transfer["mux"], TIMEOUT, why="the segmented transfer timed out")

    def sdo(self, data):
        command, mux = data[0], data[1:4]
        index, sub = mux[0] | mux[1] << 8, mux[2]
        specifier = command >> 5
        try:
            if specifier == 2:
                self.transfer = None
                kind, access, value = self.entry(index, sub)
                if access == "absent":
                    raise Abort(NO_ENTRY)
                if value is None:
                    size = SIZES[kind]
                    head = bytes([0x43 | (4 - size) << 2]) + mux
                    self.expect(0x580 + self.node, [*head, *[None] * size, *[0] * (4 - size)])
                    return
                value = octets(kind, value)
                if len(value) <= 4 and value:
                    self.answer(bytes([0x43 | (4 - len(value)) << 2]) + mux + value)
                else:
                    self.answer(b"\x41" + mux + struct.pack("<I", len(value)))
                    self.transfer = dict(mux=mux, read=value, toggle=0, until=self.now + 5_000_000)
            elif specifier == 1:
                self.transfer = None
                kind, access, _ = self.entry(index, sub)
                if access != "rw":
                    raise Abort(READ_ONLY, *[NO_ENTRY] * (access == "absent"))
                if command & 2:
                    size = 4 - (command >> 2 & 3) if command & 1 else min(SIZES.get(kind, 4), 4)
                    self.finish(kind, index, sub, data[4 : 4 + size], mux)
                else:
                    size = struct.unpack("<I", data[4:])[0] if command & 1 else None
                    if size is not None:
                        self.check_size(kind, size)
                    self.answer(b"\x60" + mux)
                    self.transfer = dict(mux=mux, write=b"", size=size, kind=kind, toggle=0, until=self.now + 5_000_000)
            elif specifier == 4:
                self.transfer = None
            elif specifier in (0, 3):
                self.segment(specifier, data)
            else:
                raise Abort(UNKNOWN)
        except Abort as abort:
            if specifier not in (0, 3):
                self.abort(mux, *abort.codes)
            else:
                self.abort(self.transfer["mux"] if self.transfer else b"\0\0\0", *abort.codes)

    def segment(self, specifier, data):
        transfer = self.transfer
        if transfer is None or ("read" in transfer) != (specifier == 3):
            raise Abort(UNKNOWN)
        if (data[0] >> 4 & 1) != transfer["toggle"]:
            raise Abort(TOGGLE)
        toggle = transfer["toggle"] << 4
        transfer["toggle"] ^= 1
        transfer["until"] = self.now + 5_000_000
        if specifier == 3:
            part, transfer["read"] = transfer["read"][:7], transfer["read"][7:]
            last = not transfer["read"]
            self.answer(bytes([toggle | (7 - len(part)) << 1 | last]) + part)
            if last:
                self.transfer = None
            return
        transfer["write"] += data[1 : 8 - (data[0] >> 1 & 7)]
        kind, size = transfer["kind"], transfer["size"]
        longest = size if size is not None else SIZES.get(kind, 10)
        if len(transfer["write"]) > longest:
            abort = Abort(MISMATCH, TOO_LONG)
            if data[0] & 1 or len(transfer["write"]) > SIZES.get(kind, 10):
                raise abort
            # More than was announced, less than the object takes: refused at once or with the last segment, CiA 301 does not say.
            self.abort(transfer["mux"], *abort.codes)
            self.expected[-1].answers += (bytes([0x20 | toggle]).ljust(8, b"\0"),)
            self.transfer = transfer | {"too_long": True}
            return
        if not data[0] & 1:
            self.answer(bytes([0x20 | toggle]))
            return
        if size is not None and len(transfer["write"]) < size:
            raise Abort(MISMATCH, TOO_SHORT)
        mux = transfer["mux"]
        self.finish(kind, mux[0] | mux[1] << 8, mux[2], transfer["write"], bytes([0x20 | toggle]))
        self.transfer = None

    def check_size(self, kind, size):
        if size > SIZES.get(kind, 10):
            raise Abort(MISMATCH, TOO_LONG)
        if kind in SIZES and size < SIZES[kind]:
            raise Abort(MISMATCH, TOO_SHORT)

    def finish(self, kind, index, sub, data, answer):
        self.check_size(kind, len(data))
        value = data if kind == "VSTR" else number(kind, data)
        within = self.store(index, sub, value) or BUS_US
        prefix = b"\x60" if len(answer) == 3 else b""
        self.answer(prefix + answer, within=within)

    # LSS.

    def lss_answer(self, *data, within=BUS_US):
        self.expect(0x7E4, bytes(data).ljust(8, b"\0"), within=within)

    def leave_configuration(self):
        self.lss_state, self.lss_seen = "waiting", []

    def lss(self, data):
        command, value = data[0], struct.unpack("<I", data[1:5])[0]
        configuring = self.lss_state == "configuration"
        if command == 0x04:
            if data[1] == 1:
                self.lss_state = "configuration"
            elif data[1] == 0 and configuring:
                self.lss_state = "waiting"
                self.lss_waiting()
            self.lss_seen = []
        elif 0x40 <= command <= 0x43:
            if configuring:
                return
            part = command - 0x40
            if part == len(self.lss_seen) and value == self.identity_number(part):
                self.lss_seen = self.lss_seen + [part]
            else:
                self.lss_seen = [0] if part == 0 and value == self.identity_number(0) else []
            if len(self.lss_seen) == 4:
                self.lss_seen = []
                self.lss_state = "configuration"
                self.lss_answer(0x44)
        elif configuring and command == 0x11:
            self.lss_answer(0x11, self.lss_node(data[1]))
        elif configuring and command == 0x13:
            right = data[1] == 0 and data[2] in self.bit_rates
            if right:
                self.pending_rate = data[2]
            self.lss_answer(0x13, 0 if right else 1)
        elif configuring and command == 0x17:
            self.lss_store()
            self.lss_answer(0x17, 0, within=MEMORY_US)
        elif configuring and 0x5A <= command <= 0x5D:
            self.lss_answer(command, *struct.pack("<I", self.identity_number(command - 0x5A)))
        elif configuring and command == 0x5E:
            self.lss_answer(command, self.node)
        else:
            self.lss_more(data)

    def identity_number(self, part):
        return self.identity[part]

    def lss_more(self, data):
        pass
