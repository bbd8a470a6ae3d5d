"""How a client joins the bus: by socketcand, or as the environment says."""

import json
import os
import socket

import can
from can.interfaces.socketcand import SocketCanDaemonBus


def expect(bus, message):
    """Receives this message alone. Frames may follow it at once, and python-can refuses what it reads together with them."""
    said = bus._SocketCanDaemonBus__socket.recv(len(message), socket.MSG_WAITALL).decode("ascii")
    if said != message:
        raise can.CanError(f"Expected '{message}' got: '{said}'")


SocketCanDaemonBus._expect_msg = expect


def address(host, port, channel):
    """The arguments of `can.Bus`: those for HOST PORT CHANNEL of socketcand, unless CAN_BUS has others in JSON."""
    others = os.environ.get("CAN_BUS")
    return json.loads(others) if others else dict(interface="socketcand", host=host, port=int(port), channel=channel)
