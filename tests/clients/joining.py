"""How a client joins the bus: by socketcand, or as the environment says."""

import json
import os


def address(host, port, channel):
    """The arguments of `can.Bus`: those for HOST PORT CHANNEL of socketcand, unless CAN_BUS has others in JSON."""
    others = os.environ.get("CAN_BUS")
    return json.loads(others) if others else dict(interface="socketcand", host=host, port=int(port), channel=channel)
