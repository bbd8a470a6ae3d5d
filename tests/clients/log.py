"""Prints the messages of a log as python-can reads it, whatever its format: time, identifier, kind, length, data."""

import sys

import can

path = sys.argv[1]
if path.endswith(".asc"):
    messages = can.ASCReader(path, relative_timestamp=False)
else:
    messages = can.LogReader(path)
for message in messages:
    if message.is_error_frame:
        print(f"{message.timestamp:.6f} error")
        continue
    digits = 8 if message.is_extended_id else 3
    kind = "remote" if message.is_remote_frame else "data"
    print(f"{message.timestamp:.6f} {message.arbitration_id:0{digits}X} {kind} {message.dlc} {message.data.hex()}".strip())
