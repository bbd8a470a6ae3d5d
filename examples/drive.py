import struct, sys, time, canopen

network = canopen.Network()
network.connect(interface="socketcand", host="127.0.0.1", port=29536, channel="pve0")

seen = None
def status(cob_id, data, timestamp):                       # the valve answers each command
    global seen
    if data != seen:
        print("status %#06x, spool %d" % struct.unpack("<Hh", data))
    seen = data

network.subscribe(0x1A0, status)
network.send_message(0x000, [0x01, 0x20])                  # NMT: start node 0x20
for word in (0x0003, 0x000B):                              # reset a fault of an earlier run
    network.send_message(0x220, struct.pack("<Hh", word, 0))
command = struct.pack("<Hh", 0x000F, 8192)                 # control word, set-point: ±16384 is ±100 %
cyclic = network.send_periodic(0x220, command, 0.1)        # DISABLED, HOLD, ACTIVE, and the spool moves
print("Enter ends")
sys.stdin.readline() or time.sleep(2)                      # without a terminal: after 2 s
network.disconnect()
