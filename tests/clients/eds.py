"""Reads and writes every object of a device by the EDS that pve-sim prints: HOST PORT CHANNEL KIND NODE-ID SERIAL.

The device is as it left the factory. What the EDS says of an object is compared with what the device does: default,
type, access, and into which PDO it can be mapped; and there is nothing beside it.
"""

import os
import pathlib
import subprocess
import sys
import tempfile

import canopen
from canopen.objectdictionary import ODVariable, datatypes

from valve import CANNOT_STORE, NO_DATA, NO_OBJECT, NO_SUB, NOT_MAPPABLE, PATIENCE, READ_ONLY, aborted, connected, equal

KIND, NODE_ID, SERIAL = sys.argv[4], int(sys.argv[5], 0), int(sys.argv[6], 0)
#: Objects without a default: the error history, empty now; the serial number, in the words of each product.
HISTORY = {(0x1003, sub) for sub in range(1, 9)}
SERIALS = {(0x1018, 4): SERIAL, (0x6052, 0): str(SERIAL), (0x650B, 0): SERIAL}
#: Objects that take a signature alone.
SIGNATURES = 0x1010, 0x1011
#: A PDO: its communication parameter, its mapping, and the access of what it can hold.
PDOS = {0x1400: (0x1600, ("rww",)), 0x1800: (0x1A00, ("ro", "rwr"))}
MAPPINGS = 0x1600, 0x1A00
INVALID, TOO_HIGH, TOO_LOW = 0x0609_0030, 0x0609_0031, 0x0609_0032
OFF = 1 << 31


def imported():
    """The object dictionary as python-canopen reads it, once dcfchk has nothing against the file."""
    sheet = subprocess.run([os.environ["PVE_SIM"], "eds", KIND], check=True, stdout=subprocess.PIPE).stdout
    assert sheet.isascii()
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder, f"{KIND}.eds")
        file.write_bytes(sheet)
        checker = pathlib.Path(sys.executable).with_name("dcfchk")
        check = subprocess.run([checker, "-n", str(NODE_ID), file], stderr=subprocess.PIPE, text=True)
        equal("dcfchk", (check.returncode, check.stderr), (0, ""))
        return canopen.import_od(str(file), NODE_ID)


def variables(dictionary):
    """Every object that can be read, sub-index by sub-index; no dummies."""
    for entry in dictionary.values():
        if entry.index >= 0x1000:
            yield from [entry] if isinstance(entry, ODVariable) else entry.values()


def same_values(sdo, dictionary):
    for variable in variables(dictionary):
        place = variable.index, variable.subindex
        if place in HISTORY:
            equal(f"default of {variable}", variable.default, None)
            with aborted(NO_DATA):
                sdo.upload(*place)
            continue
        held = sdo.upload(*place)
        wanted = SERIALS.get(place, variable.default)
        equal(f"default of {variable}", variable.default is None, place in SERIALS)
        equal(f"{variable}", variable.decode_raw(held), wanted)
        if variable.data_type != datatypes.VISIBLE_STRING:
            equal(f"bits of {variable}", 8 * len(held), len(variable))


def same_access(sdo, dictionary):
    for variable in variables(dictionary):
        place = variable.index, variable.subindex
        if not variable.writable:
            with aborted(READ_ONLY):
                sdo.download(*place, bytes(len(variable) // 8 or 4))
        elif variable.index in SIGNATURES:
            with aborted(CANNOT_STORE):
                sdo.download(*place, bytes(4))
        else:
            sdo.download(*place, sdo.upload(*place))


def same_limits(sdo, dictionary):
    """What can be written takes its limits, and nothing beyond them that its type has."""
    looked_at = 0
    for variable in variables(dictionary):
        place = variable.index, variable.subindex
        # The number of mapped objects depends on those.
        if not variable.writable or variable.min is None or variable.index in MAPPINGS:
            continue
        before = sdo.upload(*place)
        size, signed = len(before), variable.data_type in datatypes.SIGNED_TYPES
        lowest, highest = (-1 << 8 * size - 1, (1 << 8 * size - 1) - 1) if signed else (0, (1 << 8 * size) - 1)
        bytes_of = lambda value: value.to_bytes(size, "little", signed=signed)
        for value in (variable.min, variable.max):
            sdo.download(*place, bytes_of(value))
        for value in (variable.min - 1, variable.max + 1):
            if lowest <= value <= highest:
                with aborted(INVALID, TOO_HIGH, TOO_LOW):
                    sdo.download(*place, bytes_of(value))
        sdo.download(*place, before)
        looked_at += 1
    assert looked_at >= 5, looked_at


def same_mapping(sdo, dictionary):
    """The first entry of each PDO takes what the EDS says, and nothing else."""
    for communication, (mapping, accesses) in PDOS.items():
        if communication not in dictionary:
            continue
        sdo.download(communication, 1, (OFF | 0x180 + NODE_ID).to_bytes(4, "little"))
        sdo.download(mapping, 0, bytes(1))
        for variable in variables(dictionary):
            bits = 8 * max(1, len(variable) // 8)
            entry = (variable.index << 16 | variable.subindex << 8 | bits).to_bytes(4, "little")
            if variable.pdo_mappable and variable.access_type in accesses:
                sdo.download(mapping, 1, entry)
            else:
                with aborted(NOT_MAPPABLE):
                    sdo.download(mapping, 1, entry)
        dummy = (0x0005_0008).to_bytes(4, "little")
        if 5 in dictionary:
            sdo.download(mapping, 1, dummy)
        else:
            with aborted(NOT_MAPPABLE):
                sdo.download(mapping, 1, dummy)


def nothing_beside(sdo, dictionary):
    """Neighbours alone: tests/node/object_dictionary.rs looks everywhere."""
    for entry in dictionary.values():
        if entry.index < 0x1000:
            continue
        for index in (entry.index - 1, entry.index + 1):
            if index not in dictionary:
                with aborted(NO_OBJECT):
                    sdo.upload(index, 0)
        for sub in range(1, 12):
            if isinstance(entry, ODVariable) or sub not in entry:
                with aborted(NO_SUB):
                    sdo.upload(entry.index, sub)


with connected() as valve:
    dictionary = imported()
    node = valve.network.add_node(NODE_ID, dictionary)
    node.sdo.RESPONSE_TIMEOUT = PATIENCE
    same_values(node.sdo, dictionary)
    same_access(node.sdo, dictionary)
    same_values(node.sdo, dictionary)
    same_limits(node.sdo, dictionary)
    same_values(node.sdo, dictionary)
    nothing_beside(node.sdo, dictionary)
    same_mapping(node.sdo, dictionary)
