"""Drives a valve by the names in its EDS, then falls silent: canopen_names.py HOST PORT BUS EDS.

pve-sim eds pvea-canopen > pvea.eds
pve-sim --device pvea-canopen@0x20
"""

import sys, threading, canopen

SET_POINT, POSITION = (f"VPOC {name}.VPOC {name}" for name in ("set-point", "actual value"))

if len(sys.argv) != 5:
    sys.exit(__doc__)
host, port, channel, eds = sys.argv[1:]
network = canopen.Network()
network.connect(interface="socketcand", host=host, port=int(port), channel=channel)
valve = network.add_node(0x20, eds)
arrived, silenced = threading.Event(), threading.Event()

def status(pdo):                                                   # the valve answers each command
    word, position = pdo["Device status word"].raw, pdo[POSITION].raw
    print(f"status {word:#06x}, spool {position}", flush=True)
    if position == 8192:
        arrived.set()

def emergency(emcy):
    print(f"EMCY {emcy.code:04X}: {emcy.get_desc()}", flush=True)
    if emcy.code == 0x8003:                                        # time guarding
        silenced.set()

print(valve.sdo["Device description"].raw, "with serial number", valve.sdo["Device serial number"].raw)
valve.rpdo.read()                                                  # the PDO mappings, from the valve itself
valve.tpdo.read()
valve.tpdo[1].add_callback(status)
valve.emcy.add_callback(emergency)
valve.nmt.state = "OPERATIONAL"

command = valve.rpdo[1]
for word in (0x0003, 0x000B):                                      # reset a fault of an earlier run
    command["Device control word"].raw = word
    command.transmit()
command["Device control word"].raw = 0x000F
command[SET_POINT].raw = 8192                                      # ±16384 is ±100 %
command.start(0.1)                                                 # DISABLED, HOLD, ACTIVE, and the spool moves
arrived.wait(60) or sys.exit("the spool does not move")
command.stop()                                                     # 250 ms later the valve reports the silence
silenced.wait(60) or sys.exit("no EMCY")
network.disconnect()
