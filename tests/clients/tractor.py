"""What the scripts of the valve on ISOBUS share: a tractor's controller by can-j1939, and an ear on the bus.

The ear is a connection of its own, python-can and nothing else: it hears what the tractor sends as well as the valve.
Nothing sleeps: every wait is for a frame, a message or a state, with a time limit.
"""

import contextlib
import faulthandler
import os
import queue
import subprocess
import sys

import can
import cantools
import j1939
from j1939 import j1939_21

import joining
from waiting import LIFE, PATIENCE, equal, take

#: can-j1939 gives up packets that the machine lets it see too late, unless it has as much patience as the scripts.
j1939_21.J1939_21.Timeout.T1 = PATIENCE
#: How often a state of can-j1939 is looked at, by its own timer, seconds.
LOOK = 0.005
#: Period of AVC, seconds: well inside the time guard of 250 ms.
CYCLE = 0.05

VALVE, TRACTOR = 0x83, 0x27
NULL, ALL = 0xFE, 0xFF
#: NAME of the valve, as the manual prints it.
VALVE_NAME = bytes.fromhex("0100200708FF0220")
#: Parameter groups.
ACKNOWLEDGEMENT, CLAIM, DM1, DM2, DM3, UNSUPPORTED = 0xE800, 0xEE00, 0xFECA, 0xFECB, 0xFECC, 0xFEEB
#: Agriculture in the NAME, as the valve has it; the on-highway group is lower.
AGRICULTURE, ON_HIGHWAY, MARINE = 2, 1, 4

#: The DBC that pve-sim prints.
DBC = cantools.database.load_string(
    subprocess.run([os.environ["PVE_SIM"], "dbc", "pvea-isobus"], check=True, stdout=subprocess.PIPE, text=True).stdout
)
AVEF, AVC = DBC.get_message_by_name("AVEF3"), DBC.get_message_by_name("AVC3")


class Ear(can.Listener):
    """Every frame on the bus, in order, with the simulator's time."""

    def __init__(self, **bus):
        self.frames = queue.SimpleQueue()
        self.bus = can.Bus(**bus)
        self.notifier = can.Notifier(self.bus, [self])

    def on_message_received(self, message):
        self.frames.put(message)

    def close(self):
        self.notifier.stop()
        self.bus.shutdown()

    def forget(self):
        while not self.frames.empty():
            self.frames.get()

    def ask_for_claims(self):
        """Asks all who is there, as one without an address may."""
        data = CLAIM.to_bytes(3, "little")
        self.bus.send(can.Message(arbitration_id=0x18EA0000 | ALL << 8 | NULL, data=data))

    def expect(self, identifier, wanted=lambda data: True, without=()):
        """The next frame with this identifier whose data are `wanted`, or satisfy it. Nothing of `without` before it."""
        matches = wanted if callable(wanted) else lambda data: data == wanted

        def is_it(frame):
            return frame.arbitration_id == identifier and matches(bytes(frame.data))

        frame, before = take(self.frames, is_it)
        bad = [str(other) for other in before if other.arbitration_id in without]
        assert not bad, f"before {identifier:08X}: {bad}"
        return frame

    def expect_flow(self, state, extend=0, retract=0):
        """Waits for an AVEF that tells this, as cantools reads it."""
        told = {"State": state, "ExtendFlow": extend, "RetractFlow": retract, "FailSafeMode": "blocked"}
        return self.expect(AVEF.frame_id, lambda data: AVEF.decode(data) == told)


class Tractor:
    """A controller application of can-j1939 that claims an address of its own, and what it receives."""

    def __init__(self, address=TRACTOR, industry_group=AGRICULTURE, arbitrary=False, **bus):
        self.name = j1939.Name(
            arbitrary_address_capable=arbitrary,
            industry_group=industry_group,
            vehicle_system=1,
            function=130,
            manufacturer_code=666,
            identity_number=1234,
        )
        self.received = queue.SimpleQueue()
        self.command = dict(State="blocked", PortFlow=0)
        self.ecu = j1939.ElectronicControlUnit()
        self.ecu.connect(**bus)
        self.ca = self.ecu.add_ca(name=self.name, device_address=address)
        self.ca.subscribe(lambda priority, pgn, source, timestamp, data: self.received.put((pgn, source, bytes(data))))
        self.ca.start()

    def close(self):
        self.ecu.stop()
        self.ecu.disconnect()

    def wait_for_state(self, *states):
        """Waits until can-j1939's address claim is in one of these states."""
        reached = queue.SimpleQueue()

        def look(_):
            if self.ca.state in states:
                reached.put(self.ca.state)
            return self.ca.state not in states

        self.ecu.add_timer(LOOK, look)
        return take(reached, lambda _: True)[0]

    def give_way(self, ear):
        """Sees that can-j1939 notices that somebody else defends the address that it claims.

        It begins to listen for that after its claim was sent, and overlooks a valve that is quicker than the machine lets
        it: then it takes the address, until it hears the next claim.
        """
        states = j1939.ControllerApplication.State
        if self.wait_for_state(states.NORMAL, states.CANNOT_CLAIM) == states.NORMAL and self.ca.device_address == VALVE:
            ear.ask_for_claims()

    def wait_until_claimed(self):
        self.wait_for_state(j1939.ControllerApplication.State.NORMAL)

    def request(self, pgn, destination=VALVE):
        self.ca.send_request(0, pgn, destination)

    def expect(self, pgn, source=VALVE):
        """The data of the next message of this group, put together from its packets if it came in several."""
        return take(self.received, lambda message: message[:2] == (pgn, source))[0][2]

    def ask(self, pgn):
        """Requests a group of the valve."""
        self.request(pgn)
        return self.expect(pgn)

    def send_command(self, _=None):
        """Sends an AVC, as cantools writes it."""
        data = AVC.encode({"FailSafeMode": "not available", **self.command})
        self.ca.send_pgn(0, 0xFE, 0x30 | VALVE & 0xF, 3, list(data))
        return True

    def drive(self, state, flow=0):
        """What the next AVCs say."""
        self.command = dict(State=state, PortFlow=flow)

    def start_commands(self):
        self.ca.add_timer(CYCLE, self.send_command)

    def stop_commands(self):
        self.stop_timer(self.send_command)

    def stop_timer(self, callback):
        """Ends a timer of can-j1939 and waits for its thread, which may be about to call back once more."""
        self.ca.remove_timer(callback)
        passed = queue.SimpleQueue()
        self.ca.add_timer(0, passed.put)
        take(passed, lambda _: True)


def bus():
    """The bus at HOST PORT CHANNEL of the command line, as python-can wants it."""
    return joining.address(*sys.argv[1:4])


@contextlib.contextmanager
def connected(**options):
    """An ear on the bus, and a tractor on it that has its address."""
    faulthandler.dump_traceback_later(LIFE, exit=True)
    ear = Ear(**bus())
    tractor = Tractor(**options, **bus())
    try:
        yield tractor, ear
    finally:
        tractor.close()
        ear.close()


def claimed(source):
    """The identifier of address claimed, from this address."""
    return 0x18EEFF00 | source


def name_bytes(name):
    return bytes(name.bytes)
