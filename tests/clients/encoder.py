"""What the scripts for angle sensors share: the sensor as python-canopen sees it (docs/behaviour.md, 9)."""

from valve import BOOT_UP, PATIENCE, object_dictionary

VENDOR, PRODUCT, REVISION = 0xDA, 925010, 0x00010007

#: Objects of the sensor: name, and type, access and what they hold; for a record those of its sub-indices.
OBJECTS = {
    0x1000: ("device type", "u32 ro", 0x00010196),
    0x1001: ("error register", "u8 ro", 0),
    0x1002: ("manufacturer status", "u32 ro", 0),
    0x1003: ("error history", {0: ("u8 ro", 0)}),
    0x1005: ("COB-ID SYNC", "u32 rw", 0x80),
    0x1008: ("name", "text ro", "HAT 1000"),
    0x1009: ("hardware version", "text ro", "01.01"),
    0x100A: ("software version", "text ro", "01.07"),
    0x1010: ("store", {0: ("u8 ro", 4)} | {sub: ("u32 rw", 1) for sub in range(1, 5)}),
    0x1011: ("restore", {0: ("u8 ro", 4)} | {sub: ("u32 rw", 1) for sub in range(1, 5)}),
    0x1014: ("COB-ID EMCY", "u32 rw", 0x81),
    0x1017: ("heartbeat time", "u16 rw", 0),
    0x1018: ("identity", {0: ("u8 ro", 4), 1: ("u32 ro", VENDOR), 2: ("u32 ro", PRODUCT), 3: ("u32 ro", REVISION), 4: ("u32 ro", 1)}),
    0x1029: ("error behaviour", {0: ("u8 ro", 2), 1: ("u8 rw", 0), 2: ("u8 rw", 0)}),
    0x1800: ("TPDO parameter", {0: ("u8 ro", 5), 1: ("u32 rw", 0x80000181), 2: ("u8 rw", 254), 3: ("u16 rw", 0), 5: ("u16 rw", 0)}),
    0x1A00: ("TPDO mapping", {0: ("u8 rw", 1), 1: ("u32 rw", 0x60040020)} | {sub: ("u32 rw", 0) for sub in range(2, 9)}),
    0x1F80: ("NMT startup", "u32 rw", 8),
    0x2001: ("node ID", {0: ("u8 ro", 2), 1: ("u8 ro", 1), 2: ("u8 rw", 1)}),
    0x2002: ("bit rate", {0: ("u8 ro", 2), 1: ("u8 ro", 2), 2: ("u8 rw", 2)}),
    0x6000: ("operating parameters", "u16 ro", 0),
    0x6001: ("resolution", "u32 ro", 16384),
    0x6002: ("range", "u32 ro", 16384),
    0x6003: ("preset", "u32 rw", 0),
    0x6004: ("position", "u32 ro", 0),
    0x6500: ("operating status", "u16 ro", 0),
    0x6501: ("single-turn resolution", "u32 ro", 16384),
    0x6503: ("alarms", "u16 ro", 0),
    0x6504: ("supported alarms", "u16 ro", 1),
    0x6505: ("warnings", "u16 ro", 0),
    0x6506: ("supported warnings", "u16 ro", 0),
    0x6507: ("profile and software version", "u32 ro", 0x01070302),
    0x6508: ("operating time", "u32 ro", 0xFFFFFFFF),
    0x6509: ("offset", "i32 ro", 0),
    0x650A: ("module", {0: ("u8 ro", 3), 1: ("i32 ro", 0), 2: ("i32 ro", 0), 3: ("i32 ro", 16383)}),
    0x650B: ("serial number", "u32 ro", 1),
}


def subs(content):
    """The sub-indices of a record, or the variable as sub-index 0."""
    return content[0] if isinstance(content[0], dict) else {0: content}


#: The same as python-canopen's dictionary wants it: without what they hold.
KINDS = {
    index: (name, {sub: kind for sub, (kind, _) in subs(content).items()} if isinstance(content[0], dict) else content[0])
    for index, (name, *content) in OBJECTS.items()
}


def at(valve, node_id):
    """The sensor under this node ID."""
    node = valve.network.add_node(node_id, object_dictionary(KINDS))
    node.sdo.RESPONSE_TIMEOUT = PATIENCE
    return node


def reset(valve, node):
    """Resets the application and waits for the boot-up; there is no reset EMCY."""
    valve.heard.forget()
    node.nmt.state = "RESET"
    valve.heard.expect(0x700 + node.id, BOOT_UP)
