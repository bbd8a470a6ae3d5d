"""An angle sensor and its master python-canopen: all objects, cyclic PDOs, PDOs by SYNC, preset, storing by group."""

from encoder import OBJECTS, at, reset, subs
from valve import INVALID, NO_OBJECT, NO_SUB, READ_ONLY, TOO_HIGH, aborted, connected, equal

NODE_ID = 1
TPDO = 0x180 + NODE_ID


def every_object(node):
    for index, (name, *content) in OBJECTS.items():
        for sub, (_, wanted) in subs(content).items():
            held = node.sdo[index] if sub == 0 and not isinstance(content[0], dict) else node.sdo[index][sub]
            equal(f"{index:04X}:{sub} ({name})", held.raw, wanted)
    for index, sub, code in ((0x1400, 0, NO_OBJECT), (0x6030, 1, NO_OBJECT), (0x1800, 4, NO_SUB), (0x1018, 5, NO_SUB)):
        with aborted(code):
            node.sdo.upload(index, sub)
    with aborted(READ_ONLY):
        node.sdo[0x6004].raw = 0
    with aborted(TOO_HIGH):
        node.sdo[0x6003].raw = 16384
    with aborted(INVALID):
        node.sdo[0x1800][2].raw = 241


def every_millisecond(valve, node):
    """So many PDOs in a row, each a millisecond after the one before; frames of others may be between."""
    node.sdo[0x1800][5].raw = 1
    node.sdo[0x1800][1].raw = TPDO
    valve.heard.forget()
    node.nmt.state = "OPERATIONAL"
    stamps = [valve.heard.expect(TPDO, bytes(4)).timestamp for _ in range(1000)]
    for number, stamp in enumerate(stamps):
        late = stamp - stamps[0] - number / 1000
        assert abs(late) < 0.00005, f"PDO {number} is {late} s late"
    node.sdo[0x1800][5].raw = 0


def every_third_sync(valve, node):
    node.sdo[0x1800][2].raw = 3
    answered = []
    for number in range(1, 10):
        valve.heard.forget()
        valve.network.sync.transmit()
        # the answer to this read comes after all that the SYNC has caused
        node.sdo[0x1000].raw
        answered += [number] * valve.heard.until(0x580 + NODE_ID).count(TPDO)
    equal("SYNCs with a PDO", answered, [3, 6, 9])


def preset_and_store(valve, node):
    sdo = node.sdo
    sdo[0x6003].raw = 4096
    equal("position", (sdo[0x6004].raw, sdo[0x6509].raw), (4096, 4096))
    sdo[0x6003].raw = 12288
    equal("position", (sdo[0x6004].raw, sdo[0x6509].raw), (12288, -4096))
    reset(valve, node)
    equal("not saved", (sdo[0x6003].raw, sdo[0x6004].raw, sdo[0x1800][2].raw), (0, 0, 254))
    # by group: the application's alone
    sdo[0x6003].raw = 12288
    sdo[0x1800][2].raw = 7
    sdo.download(0x1010, 3, b"save")
    reset(valve, node)
    equal("saved", (sdo[0x6003].raw, sdo[0x6004].raw, sdo[0x1800][2].raw), (12288, 12288, 254))
    sdo[0x1800][2].raw = 7
    sdo.download(0x1010, 2, b"save")
    sdo.download(0x1011, 3, b"load")
    reset(valve, node)
    equal("restored", (sdo[0x6003].raw, sdo[0x6004].raw, sdo[0x1800][2].raw), (0, 0, 7))
    sdo.download(0x1011, 1, b"load")
    reset(valve, node)
    every_object(node)


with connected() as valve:
    node = at(valve, NODE_ID)
    every_object(node)
    every_millisecond(valve, node)
    every_third_sync(valve, node)
    preset_and_store(valve, node)
