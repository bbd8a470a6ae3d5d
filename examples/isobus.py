"""Drives a valve on ISOBUS with the messages of its DBC, then falls silent: isobus.py HOST PORT BUS DBC.

pve-sim dbc pvea-isobus > pvea.dbc
pve-sim --device pvea-isobus@0x80
"""

import itertools, sys, threading, cantools, j1939

if len(sys.argv) != 5:
    sys.exit(__doc__)
host, port, channel, dbc = sys.argv[1:]
messages = cantools.database.load_file(dbc)
avc, avef, dm1 = map(messages.get_message_by_name, ("AVC0", "AVEF0", "DM1_80"))
groups = {message.frame_id >> 8 & 0x1FFFF: message for message in (avef, dm1)}
arrived, silenced = threading.Event(), threading.Event()
flows = itertools.chain([0, 0], itertools.repeat(50))              # two neutral AVCs end a shutdown of an earlier run

def receive(priority, pgn, source, timestamp, data):
    if source != 0x80 or pgn not in groups:
        return
    told = groups[pgn].decode(data)
    if pgn == 0xFECA:                                              # DM1: the active faults
        print(f"DM1: {told['SPN']}, {told['FMI']}", flush=True)
        if told["SPN"] != "none" and arrived.is_set():
            silenced.set()
    elif told["ExtendFlow"] == 50 and not arrived.is_set():        # AVEF, every 100 ms
        print(f"AVEF: {told['State']}, {told['ExtendFlow']} %", flush=True)
        arrived.set()

def command(_):
    if master.state == j1939.ControllerApplication.State.NORMAL:   # after the address claim
        data = avc.encode({"State": "extend", "PortFlow": next(flows), "FailSafeMode": "not available"})
        master.send_pgn(0, avc.frame_id >> 16 & 0xFF, avc.frame_id >> 8 & 0xFF, 3, list(data))
    return True                                                    # again 100 ms later

tractor = j1939.ElectronicControlUnit()
tractor.connect(interface="socketcand", host=host, port=int(port), channel=channel)
name = j1939.Name(industry_group=2, vehicle_system=1, function=130, manufacturer_code=666, identity_number=1)
master = tractor.add_ca(name=name, device_address=0x27)
tractor.subscribe(receive)
master.start()                                                     # claims the address
master.add_timer(0.1, command)
arrived.wait(60) or sys.exit("the spool does not move")
master.remove_timer(command)                                       # 250 ms later the valve reports the silence
silenced.wait(60) or sys.exit("no DM1")
tractor.stop()
tractor.disconnect()
