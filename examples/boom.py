"""Moves a boom to an angle and holds it there, through a valve and an angle sensor: boom.py HOST PORT BUS DEGREES.

pve-sim --device pvea-canopen --device hat1000,bit-rate=250k --link pvea-canopen=hat1000
"""

import struct, sys, can

if len(sys.argv) != 5:
    sys.exit(__doc__)
host, port, channel, degrees = sys.argv[1:]
bus = can.Bus(interface="socketcand", host=host, port=int(port), channel=channel)

def send(cob_id, layout, *values):
    bus.send(can.Message(arbitration_id=cob_id, data=struct.pack(layout, *values), is_extended_id=False))

send(0x601, "<BHBI", 0x2B, 0x1800, 5, 20)                          # SDO to the sensor: the position every 20 ms
send(0x601, "<BHBI", 0x23, 0x1800, 1, 0x181)                       # as TPDO 0x181
send(0x000, "BB", 0x01, 0x00)                                      # NMT: start all nodes
for word in (0x0003, 0x000B):                                      # the valve: reset a fault of an earlier run
    send(0x220, "<Hh", word, 0)

calm = 0
while calm < 50:                                                   # one second within half a degree
    frame = bus.recv(60) or sys.exit("the sensor is silent")
    if frame.arbitration_id == 0x181:
        angle = int.from_bytes(frame.data, "little") * 360 / 16384
        away = float(degrees) - angle
        opening = max(-16384, min(16384, round(away * 1638.4)))    # full stroke from 10 degrees on
        send(0x220, "<Hh", 0x000F, opening)                        # RPDO to the valve: active, set-point
        calm = calm + 1 if abs(away) < 0.5 else 0
        print(f"{frame.timestamp:.3f} {angle:.2f}", flush=True)
bus.shutdown()
