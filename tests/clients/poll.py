"""A master that polls all 127 valves of a bus in turn: each read is answered, and nothing else is on the bus.

HOST PORT CHANNEL ROUNDS
"""

import faulthandler
import sys

import can

from valve import LIFE, PATIENCE, TESTER, equal

HOST, PORT, CHANNEL, ROUNDS = sys.argv[1:5]
VALVES = range(1, 128)
READ = bytes.fromhex("40 00 10 00 00 00 00 00")
DEVICE_TYPE = bytes.fromhex("43 00 10 00 98 01 00 00")
#: UDS to one of the valves and back: less urgent than all that the valves send at their start. Heartbeats are off.
UDS_REQUEST = 0x1BC00000 | TESTER << 11 | VALVES[-1]
UDS_ANSWER = 0x1BC00000 | VALVES[-1] << 11 | TESTER

faulthandler.dump_traceback_later(LIFE, exit=True)
with can.Bus(interface="socketcand", host=HOST, port=int(PORT), channel=CHANNEL) as bus:
    bus.send(can.Message(arbitration_id=UDS_REQUEST, is_extended_id=True, data=bytes.fromhex("03 22 F0 10")))
    while (heard := bus.recv(timeout=PATIENCE)) and heard.arbitration_id != UDS_ANSWER:
        pass
    assert heard, "no answer to UDS"
    for _ in range(int(ROUNDS)):
        for valve in VALVES:
            bus.send(can.Message(arbitration_id=0x600 + valve, is_extended_id=False, data=READ))
            answer = bus.recv(timeout=PATIENCE)
            assert answer, f"no answer from {valve:02X}"
            equal("answer", (answer.arbitration_id, bytes(answer.data)), (0x580 + valve, DEVICE_TYPE))
