"""Frames on a raw socket of SocketCAN."""

import struct
import time

from waiting import PATIENCE

FRAME = struct.Struct("=IB3x8s")


def send(link, identifier, data):
    link.send(FRAME.pack(identifier, len(data), data))


def hear(link, identifier, patience=PATIENCE):
    """The data of the next frame with this identifier, with its flags; `patience` in seconds."""
    deadline = time.monotonic() + patience
    while (left := deadline - time.monotonic()) > 0:
        link.settimeout(left)
        number, length, data = FRAME.unpack(link.recv(FRAME.size))
        if number == identifier:
            return data[:length]
    raise TimeoutError(f"no {identifier:03X}")
