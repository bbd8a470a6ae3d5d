"""What nodes and masters say that are no stand-ins, for the trace to name: block transfers, LSS, TIME, packets.

A request to all for their claims is the only one that a stand-in answers.
"""

from valve import connected, equal

FRAMES = """
    605: C6 00 20 01 19 00 00 00   block download, 25 bytes, by segments that come again
    585: A4 00 20 01 02 00 00 00
    605: 01 01 02 03 04 05 06 07
    605: 02 08 09 0A 0B 0C 0D 0E
    585: A2 01 03 00 00 00 00 00
    605: 01 08 09 0A 0B 0C 0D 0E
    605: 02 0F 10 11 12 13 14 15
    605: 83 16 17 18 19 00 00 00
    585: A2 03 03 00 00 00 00 00
    605: CD 34 12 00 00 00 00 00
    585: A1 00 00 00 00 00 00 00
    605: A4 08 10 00 02 00 00 00   block upload
    585: C6 08 10 00 0C 00 00 00
    605: A3 00 00 00 00 00 00 00
    585: 01 42 4C 4F 43 4B 20 54
    585: 82 52 41 4E 53 00 00 00
    605: A2 02 02 00 00 00 00 00
    585: C5 34 12 00 00 00 00 00
    605: A1 00 00 00 00 00 00 00
    605: C4 00 20 01 00 00 00 00   given up
    585: 80 00 20 01 02 00 04 05
    605: 40 08 10 00 00 00 00 00   in segments, without a size
    585: 40 08 10 00 00 00 00 00
    605: 60 00 00 00 00 00 00 00
    585: 00 41 42 43 44 45 46 47
    605: 70 00 00 00 00 00 00 00
    585: 1B 48 49 00 00 00 00 00
    605: 20 00 20 02 00 00 00 00
    585: 60 00 20 02 00 00 00 00
    605: 0D 01 00 00 00 00 00 00
    585: 20 00 00 00 00 00 00 00
    605: 80 00 20 02 00 00 00 08
    705: 00   network management, SYNC with a counter, TIME, EMCY, PDOs
    705: 7F
    000: 01 05
    705: 05
    000: 80 05
    000: 02 05
    705: 04
    000: 81 05
    000: 82 05
    080: 07
    100: 95 2C B3 F2 ED 3B
    085: 30 81 11 01 02 03 04 05
    085: 00 00 00 00 00 00 00 00
    185: 01 02 03
    285: 01 02 03 04 05 06 07 08
    505: 0F
    7E5: 40 DB 00 00 00 00 00 00   LSS: selects, asks and sets a slave that is not there
    7E5: 41 02 00 00 00 00 00 00
    7E5: 42 03 00 00 00 00 00 00
    7E5: 43 04 00 00 00 00 00 00
    7E4: 44 00 00 00 00 00 00 00
    7E5: 5A 00 00 00 00 00 00 00
    7E4: 5A DB 00 00 00 00 00 00
    7E5: 5B 00 00 00 00 00 00 00
    7E4: 5B 02 00 00 00 00 00 00
    7E5: 5C 00 00 00 00 00 00 00
    7E4: 5C 03 00 00 00 00 00 00
    7E5: 5D 00 00 00 00 00 00 00
    7E4: 5D 04 00 00 00 00 00 00
    7E5: 5E 00 00 00 00 00 00 00
    7E4: 5E 06 00 00 00 00 00 00
    7E5: 11 06 00 00 00 00 00 00
    7E4: 11 01 00 00 00 00 00 00
    7E5: 13 00 02 00 00 00 00 00
    7E4: 13 00 00 00 00 00 00 00
    7E5: 15 E8 03 00 00 00 00 00
    7E5: 17 00 00 00 00 00 00 00
    7E4: 17 02 00 00 00 00 00 00
    7E5: 46 DB 00 00 00 00 00 00
    7E5: 47 02 00 00 00 00 00 00
    7E5: 48 03 00 00 00 00 00 00
    7E5: 49 03 00 00 00 00 00 00
    7E5: 4A 05 00 00 00 00 00 00
    7E5: 4B 06 00 00 00 00 00 00
    7E4: 4F 00 00 00 00 00 00 00
    7E5: 4C 00 00 00 00 00 00 00
    7E4: 50 00 00 00 00 00 00 00
    7E5: 51 DB 00 00 00 05 00 00
    7E5: 04 00 00 00 00 00 00 00
    18EEFF28: D3 04 40 53 00 82 02 20   ISOBUS: a claim, requests, refusals, other groups
    18EAFF28: 00 EE 00
    18EA2928: EB FE 00
    18E8FF29: 01 FF FF FF 28 EB FE 00
    18E8FF29: 02 FF FF FF 28 CC FE 00
    18EF2928: 01
    18FEF128: FF FF FF FF FF FF FF FF
    18FECA28: 40 FF 64 00 03 02 FF FF
    1CECFF28: 20 09 00 02 FF D8 FE 00   commanded address, for a NAME that nobody has
    1CEBFF28: 01 D3 04 40 53 00 82 02
    1CEBFF28: 02 21 99 FF FF FF FF FF
    1CEC2928: 10 09 00 02 FF D8 FE 00   the same on a connection
    1CEC2829: 11 02 01 FF FF D8 FE 00
    1CEB2928: 01 D3 04 40 53 00 82 02
    1CEB2928: 02 21 99 FF FF FF FF FF
    1CEC2829: 13 09 00 02 FF D8 FE 00
    1CEC2829: FF 03 FF FF FF CB FE 00
"""


def frames():
    for line in FRAMES.strip().splitlines():
        cob_id, _, rest = line.strip().partition(": ")
        yield cob_id, bytes.fromhex(rest.split("   ")[0])


with connected() as valve:
    for cob_id, data in frames():
        valve.network.send_message(int(cob_id, 16), data)
    # the answer to this read comes after all of them
    equal("1018:1", valve.node.sdo[0x1018][1].raw, 0x01000019)
