"""What the client scripts share: the valve as python-canopen sees it, and an ear on the bus that keeps frames in order.

Nothing sleeps: every wait is for a frame, with a time limit.
"""

import contextlib
import faulthandler
import logging
import queue
import struct
import sys
import threading
import time

import can
import canopen
from can.broadcastmanager import ThreadBasedCyclicSendTask
from canopen.objectdictionary import ObjectDictionary, ODRecord, ODVariable, datatypes

import joining
from waiting import LIFE, PATIENCE, equal

NODE_ID = 0x20
#: The address that a UDS tester has.
TESTER = 0xF1
BOOT_UP = bytes([0])
NO_ERROR = bytes(8)
INIT, DISABLED, HOLD, ACTIVE, FAULT_HOLD = 0x08, 0x09, 0x0B, 0x0F, 0x03
FLOAT = 32767
#: SDO abort codes.
UNKNOWN_COMMAND, READ_ONLY, NO_OBJECT, NO_SUB = 0x05040001, 0x06010002, 0x06020000, 0x06090011
NOT_MAPPABLE, MAPPING_TOO_LONG = 0x06040041, 0x06040042
TOO_LONG, TOO_SHORT = 0x06070012, 0x06070013
INVALID, TOO_HIGH, TOO_LOW = 0x06090030, 0x06090031, 0x06090032
CANNOT_STORE, WRONG_STATE, NO_DATA = 0x08000020, 0x08000022, 0x08000024
#: Period of the cyclic set-point, seconds: well inside the time guard of 250 ms.
CYCLE = 0.05

U8, U16, U32 = datatypes.UNSIGNED8, datatypes.UNSIGNED16, datatypes.UNSIGNED32
I8, I16, TEXT = datatypes.INTEGER8, datatypes.INTEGER16, datatypes.VISIBLE_STRING

TYPES = {
    "u8": datatypes.UNSIGNED8,
    "u16": datatypes.UNSIGNED16,
    "u32": datatypes.UNSIGNED32,
    "i8": datatypes.INTEGER8,
    "i16": datatypes.INTEGER16,
    "i32": datatypes.INTEGER32,
    "text": datatypes.VISIBLE_STRING,
}
MAPPING = ["u8 rw"] + 8 * ["u32 rw"]

#: Objects of the valve: name, and type and access; for a record those of its sub-indices (docs/behaviour.md, 4.1).
OBJECTS = {
    0x1000: ("device type", "u32 ro"),
    0x1001: ("error register", "u8 ro"),
    0x1003: ("error history", ["u8 rw"] + 8 * ["u32 ro"]),
    0x1005: ("COB-ID SYNC", "u32 rw"),
    0x100A: ("software version", "text ro"),
    0x1010: ("store", ["u8 ro", "u32 rw"]),
    0x1011: ("restore", {0: "u8 ro", 1: "u32 rw", 5: "u32 rw"}),
    0x1014: ("COB-ID EMCY", "u32 ro"),
    0x1017: ("heartbeat time", "u16 rw"),
    0x1018: ("identity", ["u8 ro"] + 4 * ["u32 ro"]),
    0x1028: ("emergency consumer", ["u8 ro", "u32 rw"]),
    0x1400: ("RPDO parameter", ["u8 ro", "u32 rw", "u8 rw"]),
    0x1600: ("RPDO mapping", MAPPING),
    0x1800: ("TPDO parameter", ["u8 ro", "u32 rw", "u8 rw"]),
    0x1A00: ("TPDO mapping", MAPPING),
    0x2001: ("supply too high", "u8 ro"),
    0x2002: ("supply too low", "u8 ro"),
    0x200F: ("temperature", "u8 ro"),
    0x2019: ("CAN bus", "u8 ro"),
    0x201D: ("spool", "u8 ro"),
    0x2023: ("time guarding", "u8 ro"),
    0x2024: ("internal error", "u8 ro"),
    0x2040: ("internal error, again", "u8 ro"),
    0x3300: ("set-point 8", "i8 rw"),
    0x3301: ("actual value 8", "i8 ro"),
    0x3302: ("actual value inverted", "i8 ro"),
    0x3303: ("set-point 16", "i16 rw"),
    0x3304: ("actual value 16", "i16 ro"),
    0x6040: ("control word", "u16 rw"),
    0x6041: ("status word", "u16 ro"),
    0x6042: ("device mode", "i8 rw"),
    0x6052: ("serial number", "text ro"),
    0x6053: ("description", "text rw"),
    0x605F: ("capability", "u32 ro"),
    0x6300: ("set-point", ["u8 ro", "i16 rw"]),
    0x6301: ("actual value", ["u8 ro", "i16 ro"]),
}


def object_dictionary(objects):
    """python-canopen's dictionary of objects: name, and the kind of a variable or those of a record's sub-indices."""

    def variable(name, index, sub, kind):
        entry = ODVariable(name, index, sub)
        data_type, entry.access_type = kind.split()
        entry.data_type = TYPES[data_type]
        return entry

    dictionary = ObjectDictionary()
    for index, (name, kinds) in objects.items():
        if isinstance(kinds, str):
            dictionary.add_object(variable(name, index, 0, kinds))
            continue
        record = ODRecord(name, index)
        for sub, kind in kinds.items() if isinstance(kinds, dict) else enumerate(kinds):
            record.add_member(variable(f"{name} {sub}", index, sub, kind))
        dictionary.add_object(record)
    return dictionary


def stop(task, flag=ThreadBasedCyclicSendTask.stop):
    """Ends a cyclic message and waits for its thread, which may be about to send it once more."""
    flag(task)
    if task.thread is not threading.current_thread():
        task.thread.join(PATIENCE)


ThreadBasedCyclicSendTask.stop = stop


class Heard(can.Listener):
    """Every frame heard on the bus, in order. Runs after python-canopen's own listener, which has then seen it too."""

    def __init__(self):
        self.frames = queue.SimpleQueue()

    def on_message_received(self, message):
        self.frames.put(message)

    def all(self):
        """What was heard so far."""
        heard = []
        while not self.frames.empty():
            heard.append(self.frames.get())
        return heard

    def next(self):
        """The next frame, whatever it is."""
        for frame in self.following(PATIENCE):
            return frame
        raise AssertionError("nothing is heard")

    def forget(self):
        """Drops what was heard so far."""
        self.all()

    def following(self, seconds):
        """The frames from now on, for so many seconds, whatever else is on the bus."""
        deadline = time.monotonic() + seconds
        with contextlib.suppress(queue.Empty):
            while True:
                yield self.frames.get(timeout=max(0, deadline - time.monotonic()))

    def until(self, cob_id, times=1):
        """The identifiers of the frames up to the one that is so often heard."""
        heard = []
        for frame in self.following(PATIENCE):
            heard.append(frame.arbitration_id)
            if heard.count(cob_id) == times:
                return heard
        raise AssertionError(f"no {cob_id:03X}; last heard: {[f'{other:03X}' for other in heard[-8:]]}")

    def expect(self, cob_id, wanted, without=()):
        """The next frame with this identifier whose data are `wanted`, or satisfy it; drops what comes before.

        Nothing with an identifier of `without` may come before.
        """
        matches = wanted if callable(wanted) else lambda data: data == wanted
        missed = []
        for frame in self.following(PATIENCE):
            data = bytes(frame.data)
            if frame.arbitration_id == cob_id and frame.is_extended_id == (cob_id > 0x7FF) and matches(data):
                return frame
            assert frame.arbitration_id not in without, f"{frame} before {cob_id:03X}"
            missed.append(f"{frame.arbitration_id:03X}#{data.hex()}")
        raise AssertionError(f"no {cob_id:03X} as wanted ({wanted}); last heard: {missed[-8:]}")


class Answers(queue.Queue):
    """Answers to LSS requests: there is one, or there is none, once `let_answer` has returned."""

    def __init__(self, let_answer):
        super().__init__()
        self.let_answer = let_answer

    def get(self, block=True, timeout=None):
        self.let_answer()
        return super().get(block=False)


class Valve:
    """A network at the valve's bus."""

    def __init__(self, host, port, channel):
        self.address = joining.address(host, port, channel)
        self.heard = Heard()
        self.network = canopen.Network()
        # how long the end of the connection waits for its reader
        self.network.NOTIFIER_CYCLE = 0.1
        self.network.listeners.append(self.heard)
        self.network.connect(**self.address)
        self.network.lss.RESPONSE_TIMEOUT = PATIENCE
        self.node = self.at(NODE_ID)

    def at(self, node_id):
        """The valve under this node ID."""
        node = self.network.add_node(node_id, object_dictionary(OBJECTS))
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

    def until_now(self, witness=NODE_ID):
        """All that the valves have had to say to what was sent before: identifiers of the frames heard since `forget`.

        UDS is answered in every NMT state, here by the valve of this node ID or address. Heartbeats and LSS let the first
        answer go before them, and the second may follow it after a frame of a third valve.
        """
        answer = 0x1BC00000 | witness << 11 | TESTER
        heard = []
        for _ in range(3):
            self.network.send_message(0x1BC00000 | TESTER << 11 | witness, bytes.fromhex("03 22 F0 10"))
            heard += self.heard.until(answer)
        return [cob_id for cob_id in heard if cob_id != answer]

    @contextlib.contextmanager
    def silence_after(self, let_answer):
        """LSS requests in here have no answer if there is none by the end of `let_answer`: no clock decides."""
        self.network.lss.responses = Answers(let_answer)
        try:
            yield
        finally:
            self.network.lss.responses = queue.Queue()

    def fast_scan(self, let_answer):
        """python-canopen's fast scan, to most of whose requests nobody answers."""
        with self.silence_after(let_answer):
            return self.network.lss.fast_scan()

    def command(self, control_word, set_point=0):
        """Sends one RPDO."""
        rpdo = self.node.rpdo[1]
        rpdo[0x6040].raw = control_word
        rpdo[0x6300].raw = set_point
        rpdo.transmit()

    def expect_status(self, status, position=None, node=None):
        """Waits for a TPDO with this status word, and this position."""
        node = node or self.node

        def as_wanted(data):
            seen = struct.unpack("<Hh", data)
            return seen[0] == status and position in (None, seen[1])

        return self.heard.expect(0x180 + node.id, as_wanted)

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


class Complaints(logging.Handler):
    """What python-can finds wrong with what it gets. A message that comes in two reads is in order."""

    def __init__(self):
        super().__init__(logging.WARNING)
        self.texts = []
        self.addFilter(lambda record: not record.getMessage().startswith("Got incomplete message"))

    def emit(self, record):
        self.texts.append(record.getMessage())


@contextlib.contextmanager
def connected():
    """The valve at HOST PORT CHANNEL of the command line."""
    faulthandler.dump_traceback_later(LIFE, exit=True)
    complaints = Complaints()
    logging.getLogger("can").addHandler(complaints)
    valve = Valve(*sys.argv[1:4])
    try:
        yield valve
    finally:
        valve.network.disconnect()
    equal("complaints of python-can", complaints.texts, [])


@contextlib.contextmanager
def aborted(*codes):
    """What is done in here is answered with this abort code, or one of these."""
    names = " or ".join(f"{code:08X}" for code in codes)
    try:
        yield
    except canopen.SdoAbortedError as abort:
        assert abort.code in codes, f"abort code: {abort.code:08X}, not {names}"
    else:
        raise AssertionError(f"not aborted with {names}")
