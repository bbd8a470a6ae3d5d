"""Moves a boom to an angle and holds it there, through a valve and an angle sensor: boom.py HOST PORT BUS DEGREES.

pve-sim --device pvea-canopen --device hat1000,bit-rate=250k --link pvea-canopen=hat1000
"""

import struct
import sys

import can

VALVE, SENSOR = 0x20, 0x01
host, port, channel, degrees = sys.argv[1:5]
with can.Bus(interface="socketcand", host=host, port=int(port), channel=channel) as bus:

    def send(cob_id, data):
        bus.send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))

    send(0x600 + SENSOR, struct.pack("<BHBHH", 0x2B, 0x1800, 5, 20, 0))  # the position every 20 ms
    send(0x600 + SENSOR, struct.pack("<BHBI", 0x23, 0x1800, 1, 0x180 + SENSOR))  # on
    send(0x000, [0x01, 0x00])  # NMT start, all nodes
    calm = 0
    while calm < 50:  # one second within half a degree
        frame = bus.recv(5) or sys.exit("the sensor is silent")
        if frame.arbitration_id == 0x180 + SENSOR:
            angle = int.from_bytes(frame.data, "little") * 360 / 16384
            away = float(degrees) - angle
            calm = calm + 1 if abs(away) < 0.5 else 0
            opening = max(-16384, min(16384, round(away * 1638.4)))  # full stroke from 10 degrees on
            send(0x200 + VALVE, struct.pack("<Hh", 0x0F, opening))
            print(f"{frame.timestamp:.3f} {angle:.2f}", flush=True)
