"""Clients that come and go at random, talk nonsense and flood the bus, while python-canopen works: for so many seconds,
each of its requests is answered, the valve's heartbeat keeps its period, and the simulator needs no more memory.

HOST PORT CHANNEL SECONDS PROCESS
"""

import contextlib
import faulthandler
import pathlib
import random
import socket
import struct
import sys
import threading
import time

from valve import LIFE, NODE_ID, PATIENCE, connected, equal

SECONDS, PROCESS = float(sys.argv[4]), sys.argv[5]
ADDRESS = sys.argv[1], int(sys.argv[2])
OPEN = b"< open " + sys.argv[3].encode() + b" >"
THREADS = 4
#: Looks at the memory, in equal parts of the time.
SAMPLES = 20
HEARTBEAT, PERIOD = 0x700 + NODE_ID, 0.02
#: How far a heartbeat may be put off: by the frame on the wire, and by more urgent ones that were there before.
WAIT = 0.002
#: How much more memory it may have at the end than at first, in KiB: clients that do not read have a queue each.
MORE = 16 * 1024


def frames(noise, count):
    """Frames that are less urgent than the heartbeat, of both formats: arbitration is that of a real bus."""
    for _ in range(count):
        identifier = f"{noise.randrange(0x721, 0x7E0):03X}" if noise.random() < 0.5 else f"{noise.randrange(0x1D000000, 0x1FFFFFFF):08X}"
        data = noise.randbytes(noise.randrange(9))
        yield f"< send {identifier} {len(data)} {data.hex(' ')} >".encode()


def rude(seed, end):
    """One client after the other, until the end."""
    noise = random.Random(seed)
    while time.monotonic() < end:
        with contextlib.suppress(OSError), socket.create_connection(ADDRESS, PATIENCE) as client:
            client.settimeout(0.2)
            match noise.randrange(7):
                case 0:
                    client.sendall(noise.randbytes(noise.randrange(5000)))
                case 1:
                    client.sendall(OPEN + b"< rawmode >" + b"".join(frames(noise, noise.randrange(2000))))
                case 2:
                    client.sendall(OPEN + b"< echo >" * noise.randrange(3000))
                case 3:
                    client.sendall(OPEN + b"< rawmode >")
                    for _ in range(noise.randrange(50)):
                        client.recv(4096)
                case 4:
                    client.sendall(OPEN + b"".join(frames(noise, noise.randrange(5))))
                case 5:
                    message = b"".join(frames(noise, 1))
                    client.sendall(OPEN + message[: noise.randrange(len(message))])
                case 6:
                    client.sendall(b"<" * noise.randrange(5000))
            if noise.random() < 0.5:
                client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


def memory():
    """Of the simulator, in KiB."""
    status = pathlib.Path(f"/proc/{PROCESS}/status").read_text()
    return int(next(line.split()[1] for line in status.splitlines() if line.startswith("VmRSS:")))


with connected() as valve:
    faulthandler.dump_traceback_later(SECONDS + LIFE, exit=True)
    valve.node.sdo[0x1017].raw = int(PERIOD * 1000)
    valve.heard.forget()
    start = time.monotonic()
    threads = [threading.Thread(target=rude, args=(seed, start + SECONDS)) for seed in range(THREADS)]
    for thread in threads:
        thread.start()
    reads, slowest, heartbeats, used = 0, 0, [], []
    while any(thread.is_alive() for thread in threads) or len(used) < SAMPLES:
        asked = time.monotonic()
        equal("1018:2", valve.node.sdo[0x1018][2].raw, 0x53360000)
        reads, slowest = reads + 1, max(slowest, time.monotonic() - asked)
        heartbeats += [frame.timestamp for frame in valve.heard.all() if frame.arbitration_id == HEARTBEAT]
        if time.monotonic() - start > (len(used) + 1) * SECONDS / SAMPLES:
            used.append(memory())
    print(f"{reads} reads, the slowest {slowest * 1000:.0f} ms; {len(heartbeats)} heartbeats; memory {used} KiB")
    first = heartbeats[0]
    late = [at - first - number * PERIOD for number, at in enumerate(heartbeats)]
    assert max(late) - min(late) < WAIT, f"heartbeats up to {(max(late) - min(late)) * 1000:.3f} ms off"
    equal("memory grows by", max(0, max(used[SAMPLES // 2 :]) - max(used[: SAMPLES // 2]) - MORE), 0)
