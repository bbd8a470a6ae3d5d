"""Reads every object of the dictionary, and writes each with what it takes and what it does not take, over SDO."""

import canopen

from valve import (
    CANNOT_STORE,
    INVALID,
    NO_DATA,
    NO_OBJECT,
    NO_SUB,
    NODE_ID,
    OBJECTS,
    READ_ONLY,
    TOO_HIGH,
    TOO_LONG,
    TOO_LOW,
    TOO_SHORT,
    UNKNOWN_COMMAND,
    WRONG_STATE,
    aborted,
    connected,
    equal,
)

SERIAL = 0x5B2E0100
DUMMY = 0x0001_0001
OFF = 1 << 31

#: What a valve from the factory reads that is not 0.
DEFAULTS = {
    (0x1000, 0): 0x198,
    (0x1005, 0): 0x80,
    (0x100A, 0): "APP-_S6m1_M_R132_CANOPEN-_11149437_-000_ 180701",
    (0x1010, 0): 1,
    (0x1010, 1): 1,
    (0x1011, 0): 5,
    (0x1011, 1): 1,
    (0x1011, 5): 1,
    (0x1014, 0): 0x80 + NODE_ID,
    (0x1018, 0): 3,
    (0x1018, 1): 0x01000019,
    (0x1018, 2): 0x53360000,
    (0x1018, 3): 0x00010020,
    (0x1018, 4): SERIAL,
    (0x1028, 0): 1,
    (0x1028, 1): OFF,
    (0x1400, 0): 2,
    (0x1400, 1): 0x200 + NODE_ID,
    (0x1400, 2): 0xFF,
    (0x1600, 0): 2,
    (0x1600, 1): 0x60400010,
    (0x1600, 2): 0x63000110,
    (0x1800, 0): 2,
    (0x1800, 1): 0x180 + NODE_ID,
    (0x1800, 2): 0xFF,
    (0x1A00, 0): 2,
    (0x1A00, 1): 0x60410010,
    (0x1A00, 2): 0x63010110,
    **{(mapping, sub): DUMMY for mapping in (0x1600, 0x1A00) for sub in range(3, 9)},
    (0x6041, 0): 0x08,
    (0x6042, 0): 1,
    (0x6052, 0): str(SERIAL),
    (0x6053, 0): "PVEA-CI S6",
    (0x605F, 0): 0x05000000,
    (0x6300, 0): 1,
    (0x6301, 0): 1,
}

#: Written and read back, in this order; the last value is the default.
LEGAL = {
    (0x1003, 0): [0],
    (0x1005, 0): [0x81, 0x100, 0x6DF, 0x80],
    (0x1017, 0): [0x7FFF, 1, 0],
    (0x1028, 1): [0x90, OFF | 0x101, OFF],
    (0x1400, 1): [OFF | 0x200 + NODE_ID, OFF | 0x300 + NODE_ID, 0x4000_0200 + NODE_ID, OFF | 0x200 + NODE_ID, 0x200 + NODE_ID],
    (0x1400, 2): [0xFF],
    (0x1800, 1): [OFF | 0x180 + NODE_ID, OFF | 0x280 + NODE_ID, 0x4000_0180 + NODE_ID, OFF | 0x180 + NODE_ID, 0x180 + NODE_ID],
    (0x1800, 2): [1, 240, 255],
    (0x3300, 0): [127, -127, 0],
    (0x3303, 0): [1000, -1000, 0],
    (0x6040, 0): [0xFFF0, 0],
    (0x6042, 0): [2, 1],
    (0x6053, 0): ["X", "7 LETTERS"[:7], "BOOM RIGHT", "PVEA-CI S6"],
    (0x6300, 1): [16384, -16384, 32767, 0],
}

#: Refused, each with the code that says why; nothing changes.
ILLEGAL = {
    (0x1003, 0): {1: INVALID, 0xFF: INVALID},
    (0x1005, 0): {0x4000_0080: INVALID, 0x2000_0080: INVALID, 0x7F: INVALID, 0x101: INVALID, 0x701: INVALID},
    (0x1010, 1): {0x73617665: CANNOT_STORE, 0: CANNOT_STORE, 0x64616F6C: CANNOT_STORE},
    (0x1011, 1): {0x6C6F6164: CANNOT_STORE, 0: CANNOT_STORE, 0x73646B70: CANNOT_STORE},
    (0x1011, 5): {0x64616F6C: CANNOT_STORE, 0: CANNOT_STORE},
    (0x1017, 0): {0x8000: TOO_HIGH, 0xFFFF: TOO_HIGH},
    (0x1028, 1): {0: INVALID, 0x2000_0090: INVALID, 0x6E0: INVALID},
    (0x1400, 1): {0x300 + NODE_ID: WRONG_STATE, 0x600 + NODE_ID + 1: INVALID},
    (0x1400, 2): {0: INVALID, 1: INVALID, 254: INVALID},
    (0x1600, 0): {0: WRONG_STATE},
    (0x1600, 1): {0x63000110: WRONG_STATE},
    (0x1800, 1): {0x280 + NODE_ID: WRONG_STATE, 0x2000_0000 + NODE_ID: INVALID},
    (0x1800, 2): {0: INVALID, 241: INVALID, 254: INVALID},
    (0x1A00, 0): {3: WRONG_STATE},
    (0x1A00, 8): {0x60410010: WRONG_STATE},
    (0x3300, 0): {-128: TOO_LOW},
    (0x3303, 0): {1001: TOO_HIGH, -1001: TOO_LOW, 32767: TOO_HIGH},
    (0x6042, 0): {0: INVALID, 3: INVALID, -1: INVALID},
    (0x6053, 0): {"ELEVEN CHAR": TOO_LONG, "X" * 100: TOO_LONG},
    (0x6300, 1): {16385: TOO_HIGH, 32766: TOO_HIGH, -16385: TOO_LOW, -32768: TOO_LOW},
}


def variables(sdo):
    """Every object, sub-index by sub-index."""
    for entry in sdo.values():
        yield from [entry] if isinstance(entry.od, canopen.objectdictionary.ODVariable) else [
            entry[sub] for sub in entry.od
        ]


def at(sdo, place):
    index, sub = place
    return sdo[index] if isinstance(sdo.od[index], canopen.objectdictionary.ODVariable) else sdo[index][sub]


def read_all(sdo):
    for variable in variables(sdo):
        place = variable.od.index, variable.od.subindex
        if place[0] == 0x1003 and place[1] > 0:
            with aborted(NO_DATA):
                variable.raw
        else:
            equal(repr(variable), variable.raw, DEFAULTS.get(place, 0))


def write_all(sdo):
    for variable in variables(sdo):
        place = variable.od.index, variable.od.subindex
        if not variable.writable:
            with aborted(READ_ONLY):
                variable.data = bytes(len(variable.od) // 8 or 4)
            continue
        if place[0] not in (0x1010, 0x1011):
            # what it holds it takes, whatever the state
            variable.raw = variable.raw
        for value in LEGAL.get(place, []):
            variable.raw = value
            equal(repr(variable), variable.raw, value)
        before = variable.raw
        assert place in ILLEGAL or place == (0x6040, 0) or place[0] in (0x1600, 0x1A00), f"{variable} takes anything"
        for value, code in ILLEGAL.get(place, {}).items():
            with aborted(code):
                variable.raw = value
            equal(repr(variable), variable.raw, before)


def write_wrong_lengths(sdo):
    for variable in variables(sdo):
        if not variable.writable or not variable.od.fixed_size:
            continue
        size = len(variable.od) // 8
        index, sub = variable.od.index, variable.od.subindex
        for length in {1, 2, 3, 4, 5, 20} - {size}:
            with aborted(TOO_SHORT if length < size else TOO_LONG):
                sdo.download(index, sub, bytes(length))
            with aborted(TOO_SHORT if length < size else TOO_LONG):
                sdo.download(index, sub, bytes(length), force_segment=True)


def ask_for_what_is_not_there(sdo):
    for index, (_, kinds) in OBJECTS.items():
        subs = kinds if isinstance(kinds, dict) else range(1 if isinstance(kinds, str) else len(kinds))
        for sub in set(range(12)) | {254, 255}:
            if sub not in subs:
                with aborted(NO_SUB):
                    sdo.upload(index, sub)
                with aborted(NO_SUB):
                    sdo.download(index, sub, bytes(4))
    neighbourhoods = (range(0x0000, 0x0020), range(0x1000, 0x1100), range(0x2000, 0x2050), range(0x6000, 0x6400))
    for index in [index for indices in neighbourhoods for index in indices] + [0x1200, 0x1401, 0x1A01, 0x1F80, 0xFFFF]:
        if index not in OBJECTS:
            with aborted(NO_OBJECT):
                sdo.upload(index, 0)
    with aborted(NO_OBJECT):
        sdo.download(0x1234, 0, bytes(4))
    with aborted(NO_OBJECT):
        sdo.download(0x1234, 0, bytes(40))


def transfer_in_every_way(sdo):
    # in segments, what would fit one frame too
    sdo.download(0x1017, 0, (1000).to_bytes(2, "little"), force_segment=True)
    equal("1017", sdo[0x1017].raw, 1000)
    sdo[0x1017].raw = 0
    # as files, with and without a size
    with sdo[0x100A].open("r") as file:
        equal("100A", file.read(), DEFAULTS[0x100A, 0])
    with sdo[0x6053].open("w") as file:
        file.write("SIZELESS")
    equal("6053", sdo[0x6053].raw, "SIZELESS")
    with sdo[0x6053].open("w", size=10) as file:
        file.write("PVEA-CI S6")
    equal("6053", sdo[0x6053].raw, "PVEA-CI S6")
    # block transfer is none of its services, and leaves nothing behind
    with aborted(UNKNOWN_COMMAND):
        sdo[0x100A].open("r", block_transfer=True)
    with aborted(UNKNOWN_COMMAND):
        sdo[0x6053].open("w", size=4, block_transfer=True)
    # a transfer that its client gives up is forgotten
    file = sdo[0x100A].open("rb", buffering=0)
    equal("first segment", file.read(7), b"APP-_S6")
    sdo.abort()
    equal("1000", sdo[0x1000].raw, 0x198)


def set_points_are_one(sdo):
    views = sdo[0x6300][1], sdo[0x3300], sdo[0x3303]

    def all_read(*values):
        equal("6300:1, 3300, 3303", tuple(view.raw for view in views), values)

    sdo[0x6300][1].raw = 8192
    all_read(8192, 64, 500)
    sdo[0x3300].raw = -127
    all_read(-16384, -127, -1000)
    sdo[0x3303].raw = 250
    all_read(4096, 32, 250)
    sdo[0x6300][1].raw = 32767
    all_read(32767, 127, 1000)
    sdo[0x6300][1].raw = 0


with connected() as valve:
    sdo = valve.node.sdo
    read_all(sdo)
    write_all(sdo)
    write_wrong_lengths(sdo)
    ask_for_what_is_not_there(sdo)
    transfer_in_every_way(sdo)
    set_points_are_one(sdo)
    # none of it has left a trace
    read_all(sdo)
