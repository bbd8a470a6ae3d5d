"""A master that moves a valve on CANopen to and fro: careful, or careless, with two mistakes.

`python3 master.py careful socketcand://127.0.0.1:29536/pve0 1` drives a valve on a bus; the last argument is the speed
of virtual time. `pve-sim campaign` starts this program for each cell of scenarios/campaigns/program-careful.toml.
`test_master.py` runs the same master in stepped time.
"""

import sys
import time
from collections.abc import Callable
from urllib.parse import urlsplit

NEVER = 2**63
#: Set-points come every 50 ms. From 1.5 s on, the valve is active, and moves to the other side every 500 ms.
CYCLE_US, ACTIVE_US, MOVEMENT_US = 50_000, 1_500_000, 500_000
#: The longest silence of heartbeats and of answers to set-points.
SILENCE_US = {0x720: 250_000, 0x1A0: 120_000}


class Master:
    """The logic, without bus and clock. Instants are in microseconds."""

    def __init__(self, send: Callable[[int, str], object], *, careful: bool) -> None:
        self.send, self.careful = send, careful
        self.configured = self.stopped = False
        self.set_point_us = NEVER
        self.silent_us: dict[int, int] = {}

    def hear(self, id: int, data: bytes, now_us: int) -> None:
        """Takes a frame from the bus."""
        if id in SILENCE_US:
            self.silent_us[id] = now_us + SILENCE_US[id]
        if id == 0x0A0 and not self.configured:  # EMCY after boot-up: no error
            self.configured = True
            self.send(0x620, "2B17 1000 6400 0000")  # 0x1017: a heartbeat every 100 ms
        elif id == 0x0A0 and (self.careful or now_us >= ACTIVE_US):  # the first mistake: an EMCY in HOLD is ignored
            self.stop()
        elif id == 0x5A0 and data[0] == 0x60:
            self.send(0x000, "01 20")  # NMT: start node 0x20
            self.set_point_us = now_us

    def poll(self, now_us: int) -> int:
        """Sends what is due, and returns the next instant at which something is due."""
        silent_us = min(self.silent_us.values(), default=NEVER)
        if not self.careful or self.stopped:
            silent_us = NEVER  # the second mistake: silence of the valve is not noticed
        if now_us >= silent_us:
            self.stop()
            silent_us = NEVER
        if now_us >= self.set_point_us:
            if now_us < ACTIVE_US:
                self.send(0x220, "0B00 0000")  # control word "hold"
            else:  # control word "active", with a set-point of 50 % to each side
                self.send(0x220, ("0F00 0020", "0F00 00E0")[(now_us - ACTIVE_US) // MOVEMENT_US % 2])
            movement_us = max(ACTIVE_US, now_us // MOVEMENT_US * MOVEMENT_US + MOVEMENT_US)
            self.set_point_us = min(self.set_point_us + CYCLE_US, movement_us)
        return min(silent_us, self.set_point_us)

    def stop(self) -> None:
        """Stops the valve, and sends no more set-points."""
        if not self.stopped:
            self.stopped = True
            self.send(0x000, "02 20")  # NMT: stop node 0x20
            self.set_point_us = NEVER


def main(kind: str, url: str, speed: float) -> None:
    """Drives the valve on a bus of pve-sim, by python-can."""
    import can

    at = urlsplit(url)
    bus = can.Bus(interface="socketcand", host=at.hostname, port=at.port, channel=at.path.strip("/"))
    began = time.monotonic()

    def now_us() -> int:
        return round((time.monotonic() - began) * speed * 1e6)

    def send(id: int, data: str) -> None:
        bus.send(can.Message(arbitration_id=id, data=bytes.fromhex(data), is_extended_id=False))

    master, due_us = Master(send, careful=kind == "careful"), 0
    while True:
        message = bus.recv(min(60, max(0, due_us - now_us()) / speed / 1e6))
        while message is not None:  # first all that has come: a late program has not lost its valve
            master.hear(message.arbitration_id, bytes(message.data), now_us())
            message = bus.recv(0)
        due_us = master.poll(now_us())


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]))
