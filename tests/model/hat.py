"""A plain model of HAT 1000 and HAT 3000, written from docs/behaviour.md section 9 and HYDAC's protocol description."""

import struct

from canopen import (
    INITIALISING, LOAD, MEMORY_US, NEVER, NOT_ALLOWED, NOT_MAPPABLE, OPERATIONAL, PDO_IS_ON, PDO_TOO_LONG, PRE_OPERATIONAL,
    SAVE, SIGNATURE, STOPPED, TOO_HIGH, Abort, Node, restricted,
)  # fmt: skip

MAPPABLE = (0x10010008, 0x10020020, 0x60040020, 0x65030010)
NOBODY = 255


class Sensor(Node):
    bit_rates, default_rate, bit_us = (0, 1, 2, 3, 4, 6, 7, 8), 2, 2

    def __init__(self, kind):
        self.kind = kind
        self.identity = (0xDA, 925010 if kind == "hat1000" else 925011, 0x00010007, 1)
        self.saved = {"C": None, "A": None}
        self.raw, self.measuring_error, self.fault, self.inhibited_until = 0, False, False, 0
        self.starting = False
        super().__init__(1)

    def power_cut(self, now):
        self.advance(now)
        self.pdo_off()
        super().power_cut(now)

    def power_up(self):
        self.held = None
        self.reset_application()

    def defaults(self, group):
        if group == "A":
            return {(0x6003, 0): 0, (0x6509, 0): 0}
        node = self.node
        return {(0x1005, 0): 0x80, (0x1014, 0): 0x80 + node, (0x1017, 0): 0, (0x1029, 1): 0, (0x1029, 2): 0,
                (0x1800, 1): 0x80000180 + node, (0x1800, 2): 254, (0x1800, 3): 0, (0x1800, 5): 0, (0x1A00, 0): 1,
                (0x1A00, 1): 0x60040020, **{(0x1A00, sub): 0 for sub in range(2, 9)}, (0x1F80, 0): 8}  # fmt: skip

    def begin(self):
        self.demanded = [self.stored_node, self.stored_rate]
        self.pending_rate = None
        self.node = self.held if self.held is not None else self.stored_node
        self.transfer, self.heartbeat_due = None, NEVER
        self.pdo_off()
        if self.node == NOBODY:
            self.nmt = INITIALISING
            self.lss_state, self.lss_seen, self.lss_position, self.identify = "waiting", [], 0, []
            self.values = self.defaults("C") | self.defaults("A")
            return
        self.values = {}
        for group in "CA":
            self.values |= self.saved[group] if self.saved[group] is not None else self.defaults(group)
        self.identify, self.stored_since, self.inhibited_until = [], False, 0
        self.boot()

    def reset_application(self):
        self.pending_node = None
        self.rate = self.stored_rate
        self.history, self.told, self.entered_in_history = [], False, False
        self.begin()
        self.look_at_fault()
        self.start_by_itself()

    def reset_communication(self):
        if self.pending_node is not None:
            self.held = self.pending_node if self.pending_node != self.stored_node else None
            self.pending_node = None
        self.begin()
        self.told = False
        self.look_at_fault()
        self.start_by_itself()

    def restart(self, action):
        node = self.held if self.held is not None else self.stored_node
        if action == self.reset_communication and self.pending_node is not None:
            node = self.pending_node
        if node == NOBODY:
            self.waiting_may_go()
            action()
        else:
            self.pdo_off()
            super().restart(action)

    def start_by_itself(self):
        self.starting = self.nmt == PRE_OPERATIONAL and self.values[0x1F80, 0] == 0x0C

    def hear(self, now, identifier, data):
        super().hear(now, identifier, data)
        waiting = [due for due in self.expected if due.why in ("boot-up", "EMCY") and not due.optional]
        if self.starting and all(due.identifier == identifier for due in waiting[:1]) and not waiting[1:]:
            # Boot-up and EMCYs are on the bus with this one.
            self.now = now
            self.starting = False
            self.enter(OPERATIONAL)

    def command(self, command):
        self.starting = False
        super().command(command)

    def heartbeat_time(self):
        return self.values[0x1017, 0]

    def entered(self, before):
        self.pdo_begins() if self.nmt == OPERATIONAL else self.pdo_off()

    # EMCY.

    def register(self):
        return 0x81 if self.fault else 0

    def emcy(self, code, field):
        cob = self.values[0x1014, 0]
        if self.nmt in (PRE_OPERATIONAL, OPERATIONAL) and not cob >> 31:
            self.expect(wire(cob), struct.pack("<HBH3x", code, self.register(), field), why="EMCY")

    def look_at_fault(self):
        if self.nmt == INITIALISING:
            return
        if self.fault and not self.told:
            self.told = True
            self.emcy(0xFF00, 2)
            if not self.entered_in_history and not self.values[0x1014, 0] >> 31:
                self.entered_in_history = True
                self.history = [0x0002FF00, *self.history][:8]
            reaction = self.values[0x1029, 2]
            if self.nmt == OPERATIONAL and reaction != 1:
                self.enter(PRE_OPERATIONAL if reaction == 0 else STOPPED)
        elif not self.fault and self.told:
            self.told = self.entered_in_history = False
            self.emcy(0, 0)

    def set_plant(self, now, changes):
        self.advance(now)
        if "angle_cdeg" in changes:
            self.raw = changes["angle_cdeg"] * 16384 // 36000
        self.measuring_error = changes.get("measuring_error", self.measuring_error)
        self.fault = changes.get("internal_fault", self.fault)
        if not self.fault and not self.told:
            self.entered_in_history = False
        self.look_at_fault()

    # TPDO 1.

    def position(self):
        return (self.raw + self.values[0x6509, 0]) % 16384

    def pdo_off(self):
        self.event_due, self.held_back = NEVER, False
        self.waiting_may_go("TPDO")

    def pdo_begins(self):
        self.pdo_off()
        self.grid()

    def grid(self):
        """The count of SYNCs and the grid of the event timer begin anew."""
        self.sync_count, self.last_sent, self.event_due = 0, None, NEVER
        self.held_back &= self.values[0x1800, 2] >= 254
        self.timer_begins()

    def timer_begins(self):
        v = self.values
        self.event_due = NEVER
        if self.nmt == OPERATIONAL and not v[0x1800, 1] >> 31 and v[0x1800, 2] >= 254 and v[0x1800, 5]:
            self.event_due = self.now + v[0x1800, 5] * 1000

    def event(self):
        self.event_due += self.values[0x1800, 5] * 1000
        if self.now < self.inhibited_until:
            self.held_back = True
        else:
            self.send_event()

    def send_event(self):
        self.held_back = False
        if self.mapped():
            self.inhibited_until = self.now + self.values[0x1800, 3] * 100
        self.tpdo()

    def timers(self):
        result = super().timers()
        if self.held_back:
            result.append((self.inhibited_until, self.send_event))
        result.append((self.event_due, self.event))
        return result

    def mapped(self):
        data = b""
        for sub in range(1, self.values[0x1A00, 0] + 1):
            entry = self.values[0x1A00, sub]
            value = self.entry(entry >> 16, 0)[2]
            data += value.to_bytes((entry & 0xFF) // 8, "little")
        return data

    def tpdo(self):
        data = self.mapped()
        if data:
            # Periods missed on a blocked bus merge. The page does not say it of SYNCs.
            self.merge("TPDO")
            self.expect(wire(self.values[0x1800, 1]), data, why="TPDO")
        self.last_sent = data

    def other(self, identifier, data):
        v = self.values
        if self.nmt != OPERATIONAL or identifier != wire(v[0x1005, 0]) or v[0x1800, 1] >> 31:
            return
        kind = v[0x1800, 2]
        if kind == 0 and self.mapped() != self.last_sent:
            self.tpdo()
        elif 1 <= kind <= 240:
            self.sync_count += 1
            if self.sync_count % kind == 0:
                self.tpdo()

    # Objects.

    def objects(self, index):
        v, ro = self.values, "ro"
        single = {
            0x1000: ("U32", ro, 0x10196), 0x1001: ("U8", ro, self.register()), 0x1002: ("U32", ro, 0),
            0x1005: ("U32", "rw"), 0x1008: ("VSTR", ro, b"HAT 1000" if self.kind == "hat1000" else b"HAT 3000"),
            0x1009: ("VSTR", ro, b"01.01"), 0x100A: ("VSTR", ro, b"01.07"), 0x1014: ("U32", "rw"), 0x1017: ("U16", "rw"),
            0x1F80: ("U32", "rw"), 0x6000: ("U16", ro, 0), 0x6500: ("U16", ro, 0), 0x6001: ("U32", ro, 16384),
            0x6002: ("U32", ro, 16384), 0x6501: ("U32", ro, 16384), 0x6003: ("U32", "rw"),
            0x6004: ("U32", ro, self.position() if v else 0), 0x6503: ("U16", ro, int(self.measuring_error)), 0x6504: ("U16", ro, 1),
            0x6505: ("U16", ro, 0), 0x6506: ("U16", ro, 0), 0x6507: ("U32", ro, 0x01070302),
            0x6508: ("U32", ro, 0xFFFFFFFF), 0x6509: ("I32", ro), 0x650B: ("U32", ro, self.identity[3]),
        }  # fmt: skip
        if index in single:
            entry = single[index]
            return {0: entry if len(entry) == 3 else (*entry, v[index, 0])}
        if index == 0x1003:
            return {0: ("U8", ro, len(self.history)), **{i + 1: ("U32", ro, e) for i, e in enumerate(self.history)}}
        if index in (0x1010, 0x1011):
            return {0: ("U8", ro, 4), **{sub: ("U32", "rw", 1) for sub in range(1, 5)}}
        if index == 0x1018:
            return {0: ("U8", ro, 4), **{i + 1: ("U32", ro, n) for i, n in enumerate(self.identity)}}
        if index == 0x1A00:
            return {sub: ("U32" if sub else "U8", "rw", v[index, sub]) for sub in range(9)}
        return {
            0x1029: {0: ("U8", ro, 2), 1: ("U8", "rw", v[0x1029, 1]), 2: ("U8", "rw", v[0x1029, 2])},
            0x1800: {0: ("U8", ro, 5), 1: ("U32", "rw", v[0x1800, 1]), 2: ("U8", "rw", v[0x1800, 2]),
                     3: ("U16", "rw", v[0x1800, 3]), 5: ("U16", "rw", v[0x1800, 5])},
            0x2001: {0: ("U8", ro, 2), 1: ("U8", ro, self.node), 2: ("U8", "rw", self.demanded[0])},
            0x2002: {0: ("U8", ro, 2), 1: ("U8", ro, self.rate), 2: ("U8", "rw", self.demanded[1])},
            0x650A: {0: ("U8", ro, 3), 1: ("I32", ro, 0), 2: ("I32", ro, 0), 3: ("I32", ro, 16383)},
        }.get(index)  # fmt: skip

    def store(self, index, sub, value):
        v = self.values
        if index in (0x1010, 0x1011):
            if value != (SAVE if index == 0x1010 else LOAD):
                raise Abort(SIGNATURE)
            for group in {1: "CA", 2: "C", 3: "A", 4: ""}[sub]:
                keys = self.defaults(group)
                self.saved[group] = {key: v[key] for key in keys} if index == 0x1010 else None
            if sub == 4:
                self.stored_node, self.stored_rate = self.demanded if index == 0x1010 else (1, 2)
                self.held = None
                # The page leaves open what LSS 0x17 does to the demanded pair when the pending node ID is stored already.
                self.stored_since = self.pending_node == self.stored_node
            return MEMORY_US
        if index == 0x2001:
            if not (1 <= value <= 127 or value == NOBODY):
                raise Abort(NOT_ALLOWED)
            self.demanded[0] = value
        elif index == 0x2002:
            if value not in self.bit_rates:
                raise Abort(NOT_ALLOWED)
            self.demanded[1] = value
        elif index == 0x1A00:
            self.store_mapping(sub, value)
        elif index in (0x1014, 0x1800) and (index, sub) != (0x1800, 2) and sub in (0, 1):
            self.store_cob_id(index, sub, value)
        elif index == 0x6003:
            if value > 16383:
                raise Abort(TOO_HIGH)
            v[0x6003, 0] = value
            v[0x6509, 0] = (value - self.raw + 8192) % 16384 - 8192
        else:
            allowed = {0x1029: value <= 2, 0x1F80: value in (8, 0x0C), 0x1005: not self.wrong_cob_id(value) and not value >> 30 & 1}
            if not allowed.get(index, True) or (index, sub) == (0x1800, 2) and not (value <= 240 or value in (254, 255)):
                raise Abort(NOT_ALLOWED)
            if (index, sub) == (0x1800, 3) and value != v[index, sub] and not v[0x1800, 1] >> 31:
                raise Abort(PDO_IS_ON)
            v[index, sub] = value
            if index == 0x1017:
                self.set_heartbeat(value)
            elif (index, sub) == (0x1800, 2):
                self.grid()
            elif (index, sub) == (0x1800, 5):
                self.timer_begins()
        return None

    def wrong_cob_id(self, value):
        if value >> 29 & 1:
            return False
        return value & 0x1FFFF800 or restricted(value & 0x7FF)

    def store_cob_id(self, index, sub, value):
        v = self.values
        before = v[index, sub]
        if value == before:
            return
        wrong = []
        if not value >> 31:
            if self.wrong_cob_id(value):
                wrong.append(NOT_ALLOWED)
            if not before >> 31 and (value ^ before) & 0x3FFFFFFF:
                wrong.append(PDO_IS_ON)
        if index == 0x1014 and value >> 30 & 1:
            wrong.append(NOT_ALLOWED)
        if wrong:
            raise Abort(*wrong)
        v[index, sub] = value
        if index == 0x1800:
            if value >> 31:
                self.pdo_off()
            elif before >> 31:
                self.pdo_begins()

    def store_mapping(self, sub, value):
        v = self.values
        count, on = v[0x1A00, 0], not v[0x1800, 1] >> 31
        if value == v[0x1A00, sub]:
            return
        wrong = [PDO_IS_ON] if on else []
        if sub == 0:
            if value > 8:
                wrong.append(PDO_TOO_LONG)
            elif value:
                entries = [v[0x1A00, i] for i in range(1, value + 1)]
                wrong += [NOT_MAPPABLE] * (0 in entries) + [PDO_TOO_LONG] * (sum(entry & 0xFF for entry in entries) > 64)
        else:
            if value not in MAPPABLE and (value or 0 < sub <= count):
                wrong.append(NOT_MAPPABLE)
            if count and not (value == 0 and sub > count):
                wrong.append(PDO_IS_ON)
        if wrong:
            raise Abort(*wrong)
        v[0x1A00, sub] = value

    # LSS.

    def lss_node(self, node):
        if not (1 <= node <= 127 or node == NOBODY):
            return 255
        self.pending_node, self.stored_since = node, False
        return 0

    def lss_store(self):
        node = self.pending_node if self.pending_node is not None else self.held
        if self.stored_since:
            node = None
        self.stored_since = True
        if node is not None:
            self.stored_node = self.demanded[0] = node
            self.held = None
        if self.pending_rate is not None:
            self.stored_rate = self.demanded[1] = self.pending_rate

    def lss_waiting(self):
        if self.node == NOBODY and self.pending_node not in (None, NOBODY) and self.stored_node == self.pending_node:
            self.restart(self.reset_communication)

    def lss_more(self, data):
        command, value = data[0], struct.unpack("<I", data[1:5])[0]
        if 0x46 <= command <= 0x4B:
            step = command - 0x46
            number = self.identity[(0, 1, 2, 2, 3, 3)[step]]
            holds = (value == number, value == number, value <= number, value >= number, value <= number, value >= number)[step]
            if step == 0:
                self.identify = [0] if holds else []
            else:
                self.identify = self.identify + [step] if holds and len(self.identify) == step else []
            if len(self.identify) == 6:
                self.identify = []
                self.lss_answer(0x4F)
        elif self.node == NOBODY and self.pending_node in (None, NOBODY):
            if command == 0x4C:
                self.lss_answer(0x50)
            elif command == 0x51 and self.lss_state == "waiting":
                self.fast_scan(value, *data[5:8])

    def fast_scan(self, value, check, sub, following):
        if check == 0x80:
            self.lss_position = 0
            self.lss_answer(0x4F)
            return
        if check > 31 or sub > 3:
            return
        if sub == 0:
            self.lss_position = 0
        if sub == self.lss_position and value >> check == self.identity[sub] >> check:
            self.lss_answer(0x4F)
            if check == 0:
                self.lss_position = following
                if sub == 3 and following in (0, 4):
                    self.lss_state, self.lss_position = "configuration", 0

    # What is worth trying.

    indices = [0x1000, 0x1001, 0x1002, 0x1003, 0x1005, 0x1008, 0x1009, 0x100A, 0x1010, 0x1011, 0x1014, 0x1017, 0x1018, 0x1029,
               0x1800, 0x1A00, 0x1F80, 0x2001, 0x2002, 0x6000, 0x6001, 0x6002, 0x6003, 0x6004, 0x6500, 0x6501, 0x6503,
               0x6504, 0x6505, 0x6506, 0x6507, 0x6508, 0x6509, 0x650A, 0x650B]  # fmt: skip
    pdos = (0x1800,)
    memory_commands = [(0x1010, sub, SAVE) for sub in (1, 2, 3, 4)] + [(0x1011, sub, LOAD) for sub in (1, 2, 3, 4)]
    plants = [dict(angle_cdeg=a) for a in (0, 1, 9000, 17999, 18000, 35999)] + [
        dict(measuring_error=on) for on in (True, False)] + [dict(internal_fault=on) for on in (True, False, False)]  # fmt: skip

    def is_text(self, index):
        return index in (0x1008, 0x1009, 0x100A)

    def worth(self, index, sub, dice):
        if index == 0x1A00 and sub:
            return [*MAPPABLE, 0, 0x60040010, 0x60030020, 0x00050008, self.values.get((index, sub), 0)]
        if index == 0x1800:
            return {1: [0x80000181, 0x80000000, 0x181, 0x1F0, 0x40000181, 0x20000181, 0x2ABCDEF0, 0x7F, 0x601],
                    2: [0, 1, 2, 3, 240, 241, 253, 254, 255], 3: [0, 0, 50, 100, 5000], 5: [0, 10, 20, 100, 1000]
                    }.get(sub, [5])  # fmt: skip
        return {
            0x1003: [0, 1], 0x1017: [0, 0, 1, 9, 95, 100, 1000, 0x7FFF, 0x8000, 0xFFFF], 0x1029: [0, 1, 2, 3],
            0x1005: [0x80, 0x80, 0xC5, 0x100, 0x40000080, 0x20000080, 0x2ABCDE00, 0x7F, 0x880, 0x601],
            0x1014: [0x81, 0x81, 0x80000081, 0x80000000, 0x90, 0x20000081, 0x40000081, 0x7F, 0x881],
            0x1A00: [0, 0, 1, 2, 3, 8, 9], 0x1F80: [8, 8, 0x0C, 4], 0x2001: [self.node, 1, 5, 127, 0, 128, 255],
            0x2002: [2, 2, 2, 5, 9, 255], 0x6003: [0, 1, 4000, 16383, 16384],
        }.get(index, [dice.getrandbits(32)])  # fmt: skip

    def state(self):
        nmt = {PRE_OPERATIONAL: "pre-operational", OPERATIONAL: "operational", STOPPED: "stopped", INITIALISING: "initialising"}
        result = dict(nmt=nmt[self.nmt])
        return result if self.node == NOBODY else result | dict(node_id=self.node, position=self.position())


def wire(cob):
    """The identifier of a COB-ID, with bit 31 for 29 bits."""
    return cob & 0x1FFFFFFF | 1 << 31 if cob >> 29 & 1 else cob & 0x7FF
