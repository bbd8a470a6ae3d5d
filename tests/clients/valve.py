"""What the client scripts share: the valve as python-canopen sees it, and an ear on the bus that keeps frames in order.

Nothing sleeps: every wait is for a frame, with a time limit.
"""

import contextlib
import faulthandler
import queue
import struct
import sys
import time

import can
import canopen
from canopen.objectdictionary import ObjectDictionary, ODRecord, ODVariable, datatypes

#: Longest wait for any single frame, seconds. Generous: a busy machine is not a fault of the valve.
PATIENCE = 10
#: After this a script that hangs says where, and ends.
LIFE = 90

NODE_ID = 0x20
BOOT_UP = bytes([0])
NO_ERROR = bytes(8)
INIT, DISABLED, HOLD, ACTIVE, FAULT_HOLD = 0x08, 0x09, 0x0B, 0x0F, 0x03
FLOAT = 32767
#: Period of the cyclic set-point, seconds: well inside the time guard of 250 ms.
CYCLE = 0.05

U8, U16, U32 = datatypes.UNSIGNED8, datatypes.UNSIGNED16, datatypes.UNSIGNED32
I8, I16, TEXT = datatypes.INTEGER8, datatypes.INTEGER16, datatypes.VISIBLE_STRING

#: Objects of the valve: index, name, and its type, or the types of its sub-indices from 0 on (docs/behaviour.md, 4.1).
OBJECTS = [
    (0x1000, "device type", U32),
    (0x1001, "error register", U8),
    (0x1003, "error history", [U8] + 8 * [U32]),
    (0x1005, "COB-ID SYNC", U32),
    (0x100A, "software version", TEXT),
    (0x1017, "heartbeat time", U16),
    (0x1018, "identity", [U8] + 4 * [U32]),
    (0x1400, "RPDO parameter", [U8, U32, U8]),
    (0x1600, "RPDO mapping", [U8] + 8 * [U32]),
    (0x1800, "TPDO parameter", [U8, U32, U8]),
    (0x1A00, "TPDO mapping", [U8] + 8 * [U32]),
    (0x2023, "time guarding", U8),
    (0x3300, "set-point 8", I8),
    (0x3301, "actual value 8", I8),
    (0x3302, "actual value inverted", I8),
    (0x3303, "set-point 16", I16),
    (0x3304, "actual value 16", I16),
    (0x6040, "control word", U16),
    (0x6041, "status word", U16),
    (0x6042, "device mode", I8),
    (0x6053, "description", TEXT),
    (0x6300, "set-point", [U8, I16]),
    (0x6301, "actual value", [U8, I16]),
]


def object_dictionary():
    def variable(name, index, sub, data_type):
        entry = ODVariable(name, index, sub)
        entry.data_type = data_type
        return entry

    dictionary = ObjectDictionary()
    for index, name, types in OBJECTS:
        if isinstance(types, list):
            record = ODRecord(name, index)
            for sub, data_type in enumerate(types):
                record.add_member(variable(f"{name} {sub}", index, sub, data_type))
            dictionary.add_object(record)
        else:
            dictionary.add_object(variable(name, index, 0, types))
    return dictionary


class Heard(can.Listener):
    """Every frame heard on the bus, in order. Runs after python-canopen's own listener, which has then seen it too."""

    def __init__(self):
        self.frames = queue.SimpleQueue()

    def on_message_received(self, message):
        self.frames.put(message)

    def forget(self):
        """Drops what was heard so far."""
        while not self.frames.empty():
            self.frames.get()

    def expect(self, cob_id, wanted):
        """The next frame with this identifier whose data are `wanted`, or satisfy it; drops what comes before."""
        matches = wanted if callable(wanted) else lambda data: data == wanted
        deadline = time.monotonic() + PATIENCE
        missed = []
        while True:
            try:
                frame = self.frames.get(timeout=max(0, deadline - time.monotonic()))
            except queue.Empty:
                raise AssertionError(f"no {cob_id:03X} as wanted ({wanted}); last heard: {missed[-8:]}") from None
            data = bytes(frame.data)
            if frame.arbitration_id == cob_id and not frame.is_extended_id and matches(data):
                return frame
            missed.append(f"{frame.arbitration_id:03X}#{data.hex()}")


class Valve:
    """A network at the valve's bus."""

    def __init__(self, host, port, channel):
        self.heard = Heard()
        self.network = canopen.Network()
        self.network.listeners.append(self.heard)
        self.network.connect(interface="socketcand", host=host, port=int(port), channel=channel)
        self.network.lss.RESPONSE_TIMEOUT = PATIENCE
        self.node = self.at(NODE_ID)

    def at(self, node_id):
        """The valve under this node ID."""
        node = self.network.add_node(node_id, object_dictionary())
        node.sdo.RESPONSE_TIMEOUT = PATIENCE
        return node

    def reset(self, node=None):
        """Resets the application and waits for boot-up and reset EMCY."""
        node = node or self.node
        self.heard.forget()
        node.nmt.state = "RESET"
        self.expect_boot(node)

    def expect_boot(self, node):
        self.heard.expect(0x700 + node.id, BOOT_UP)
        self.heard.expect(0x080 + node.id, NO_ERROR)

    def command(self, control_word, set_point=0):
        """Sends one RPDO."""
        rpdo = self.node.rpdo[1]
        rpdo[0x6040].raw = control_word
        rpdo[0x6300].raw = set_point
        rpdo.transmit()

    def expect_status(self, status, position=None):
        """Waits for a TPDO with this status word, and this position."""
        def as_wanted(data):
            seen = struct.unpack("<Hh", data)
            return seen[0] == status and position in (None, seen[1])

        return self.heard.expect(0x180 + self.node.id, as_wanted)

    def boot_to_active(self):
        """Use case 1 of the manual; leaves the cyclic set-point 0 running."""
        self.reset()
        self.node.rpdo.read()
        self.node.tpdo.read()
        self.heard.forget()
        self.network.nmt.state = "OPERATIONAL"
        for status in (DISABLED, HOLD, ACTIVE):
            self.command(0x0F)
            self.expect_status(status, 0)
        self.node.rpdo[1].start(CYCLE)


@contextlib.contextmanager
def connected():
    """The valve at HOST PORT CHANNEL of the command line."""
    faulthandler.dump_traceback_later(LIFE, exit=True)
    valve = Valve(*sys.argv[1:4])
    try:
        yield valve
    finally:
        valve.network.disconnect()


def equal(what, seen, wanted):
    assert seen == wanted, f"{what}: {seen!r}, not {wanted!r}"
