"""udsoncan over can-isotp, as a service tool uses them: it reads the identification and writes a node ID.

HOST PORT CHANNEL NODE SERIAL NEW: the valve's node ID, its serial number, and the node ID that it is to get.
"""

import contextlib
import faulthandler
import sys

import can
import isotp
import udsoncan
from udsoncan.client import Client
from udsoncan.connections import PythonIsoTpConnection
from udsoncan.exceptions import NegativeResponseException

from valve import LIFE, PATIENCE, TESTER, equal

HOST, PORT, CHANNEL = sys.argv[1:4]
NODE, SERIAL, NEW = (int(text, 0) for text in sys.argv[4:])
NODE_ID, DIAGNOSTICS, HARDWARE_VERSION, SERIAL_NUMBER, NOBODY = 0x1001, 0xF010, 0xF193, 0xF18C, 0xABCD
#: The answer to a write of the node ID has this identifier, whatever the node ID is.
NODE_ID_WRITTEN = 0x1BC408F1
FIRST_ADDRESS = 0x80
OUT_OF_RANGE, ACCESS_DENIED = 0x31, 0x33


class Raw(udsoncan.DidCodec):
    """The bytes as they are."""

    def __init__(self, length):
        self.length = length

    def encode(self, value):
        return value

    def decode(self, payload):
        return bytes(payload)

    def __len__(self):
        return self.length


LENGTHS = {NODE_ID: 1, DIAGNOSTICS: 1, HARDWARE_VERSION: 4, SERIAL_NUMBER: 4, NOBODY: 1}


@contextlib.contextmanager
def tool(bus, rxid):
    address = isotp.Address(isotp.AddressingMode.Normal_29bits, txid=0x1BC00000 | TESTER << 11 | NODE, rxid=rxid)
    stack = isotp.CanStack(bus, address=address)
    config = {
        "request_timeout": PATIENCE,
        "p2_timeout": PATIENCE,
        "data_identifiers": {did: Raw(length) for did, length in LENGTHS.items()},
    }
    with Client(PythonIsoTpConnection(stack), config=config) as client:
        yield client


@contextlib.contextmanager
def refused(code):
    try:
        yield
    except NegativeResponseException as refusal:
        equal("code", f"{refusal.response.code:02X}", f"{code:02X}")
    else:
        raise AssertionError(f"not refused with {code:02X}")


faulthandler.dump_traceback_later(LIFE, exit=True)
with can.Bus(interface="socketcand", host=HOST, port=int(PORT), channel=CHANNEL) as bus:
    if NODE >= FIRST_ADDRESS:
        # a valve on ISOBUS is silent until its claim has stood for 250 ms: then comes its first AVEF
        while (heard := bus.recv(PATIENCE)) and heard.arbitration_id != 0x0CFE1000 | (NODE & 0x0F) << 8 | NODE:
            pass
        assert heard, "no AVEF"
    with tool(bus, 0x1BC00000 | NODE << 11 | TESTER) as client:
        read = lambda did: client.read_data_by_identifier_first(did)
        equal("F010", read(DIAGNOSTICS), b"\xa5")
        equal("hardware version", read(HARDWARE_VERSION), b"1.00")
        equal("serial number", read(SERIAL_NUMBER), SERIAL.to_bytes(4, "big"))
        equal("node ID", read(NODE_ID), bytes([NODE]))
        with refused(OUT_OF_RANGE):
            read(NOBODY)
        with refused(ACCESS_DENIED):
            client.write_data_by_identifier(SERIAL_NUMBER, bytes(4))
    with tool(bus, NODE_ID_WRITTEN) as client:
        with refused(OUT_OF_RANGE):
            client.write_data_by_identifier(NODE_ID, b"\x00")
        client.write_data_by_identifier(NODE_ID, bytes([NEW]))
    with tool(bus, 0x1BC00000 | NODE << 11 | TESTER) as client:
        equal("node ID, stored", client.read_data_by_identifier_first(NODE_ID), bytes([NEW]))
