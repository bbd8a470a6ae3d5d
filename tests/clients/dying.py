"""Clients that talk nonsense, that die in the middle of a message, and that come in floods, while python-canopen works.

The simulator has fewer file descriptors than the flood has connections.
"""

import contextlib
import random
import socket
import struct

from valve import NODE_ID, PATIENCE, connected, equal

HEARTBEAT = 0x700 + NODE_ID
PERIOD_MS = 20
#: The identifier of what dying clients send; nobody else uses it.
STRAY = 0x123
SEND = b"< send 123 8 1 2 3 4 5 6 7 8 >"
SENT = bytes(range(1, 9))
FLOOD = 150


class Client:
    """A client of socketcand that is as rude as it likes."""

    def __init__(self, valve):
        self.socket = socket.create_connection((valve.address["host"], valve.address["port"]), PATIENCE)
        self.channel = valve.address["channel"].encode()

    def say(self, text):
        self.socket.sendall(text)

    def hear(self):
        """The next message."""
        message = b""
        while not message.endswith(b">"):
            byte = self.socket.recv(1)
            assert byte, f"the connection ended after {message}"
            message += byte
        return message

    def open(self):
        equal("greeting", self.hear(), b"< hi >")
        self.say(b"< open " + self.channel + b" >")
        equal("answer to open", self.hear(), b"< ok >")

    def leave(self):
        self.socket.close()

    def hang_up(self):
        """Says that nothing more comes, then leaves."""
        self.socket.shutdown(socket.SHUT_WR)
        self.socket.close()

    def die(self):
        """Leaves with a reset, as when its process is killed with answers unread."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.socket.close()


class Witness:
    """The client that works all the time."""

    def __init__(self, valve):
        self.valve = valve
        self.strays = []
        self.heartbeats = []
        valve.node.sdo[0x1017].raw = PERIOD_MS
        valve.heard.forget()

    def works(self):
        """Its requests are answered, and nobody is in the way of the valve's heartbeat."""
        equal("1018:2", self.valve.node.sdo[0x1018][2].raw, 0x53360000)
        for frame in self.valve.heard.all():
            if frame.arbitration_id == STRAY:
                self.strays.append(bytes(frame.data))
            elif frame.arbitration_id == HEARTBEAT:
                self.heartbeats.append(frame.timestamp)
            else:
                equal("identifier", f"{frame.arbitration_id:03X}", f"{0x580 + NODE_ID:03X}")

    def saw(self, strays):
        """What was on the bus of those that died, and has not been asked for yet."""
        self.works()
        seen, self.strays = self.strays, []
        equal("strays", seen, strays)

    def heard_every_heartbeat(self):
        """None is missing. More urgent frames, of which several can come at once, may put one off by some ms."""
        for before, after in zip(self.heartbeats, self.heartbeats[1:]):
            period = (after - before) * 1000
            assert abs(period - PERIOD_MS) < PERIOD_MS / 4, f"{period} ms between heartbeats"
        assert len(self.heartbeats) > 10, f"{len(self.heartbeats)} heartbeats"


def in_the_middle_of_a_message(valve, witness):
    for leave in (Client.leave, Client.hang_up, Client.die):
        for end in range(len(SEND)):
            client = Client(valve)
            client.open()
            client.say(SEND[:end])
            leave(client)
            witness.works()
    for handshake in (b"", b"<", b"< open", b"< open nowhere >", b"< open pve0 >< rawmode", b"< open pve0 >< rawmode >"):
        for leave in (Client.leave, Client.hang_up, Client.die):
            client = Client(valve)
            client.say(handshake)
            leave(client)
            witness.works()
    witness.saw([])


def after_a_message(valve, witness):
    """What was said to the end is done."""
    client = Client(valve)
    client.open()
    client.say(3 * SEND + SEND[:10] + b"< echo >")
    for wanted in (b"< error unterminated message >", b"< echo >"):
        equal("answer", client.hear(), wanted)
    client.die()
    witness.saw(3 * [SENT])


def nonsense(valve, witness):
    """Each is told what is wrong, and can go on."""
    client = Client(valve)
    equal("greeting", client.hear(), b"< hi >")
    for wrong in (
        b"< >",
        b"< hello >",
        b"< send 123 1 1 >",
        b"< rawmode >",
        b"< open >",
        b"< open nowhere >",
    ):
        client.say(wrong)
        assert client.hear().startswith(b"< error "), wrong
    client.say(b"< open pve0 >")
    equal("answer to open", client.hear(), b"< ok >")
    for wrong in (
        b"< open pve0 >",
        b"< send >",
        b"< send 123 >",
        b"< send 123 2 1 >",
        b"< send 123 1 1 2 >",
        b"< send 123 9 1 2 3 4 5 6 7 8 9 >",
        b"< send 123 1 100 >",
        b"< send 800 1 1 >",
        b"< send 20000000 1 1 >",
        b"< send xyz 1 1 >",
        b"< send 123 1 -81 >",
        b"< send \xff\xfe 1 1 >",
        b"< subscribe 0 0 123 >",
        b"<" + 1000 * b" 1" + b" >",
    ):
        client.say(wrong)
        assert client.hear().startswith(b"< error "), wrong
    client.say(b"noise between messages" + SEND + b"\r\n\0" + SEND)
    client.say(b"< echo >")
    equal("answer", client.hear(), b"< echo >")
    witness.saw(2 * [SENT])
    client.leave()


def garbage(valve, witness):
    noise = random.Random(408)
    for leave in (Client.leave, Client.hang_up, Client.die):
        for text in (
            noise.randbytes(20_000),
            b"<" * 20_000,
            b">" * 20_000,
            b"< send " * 3_000,
            b"<" + b"x" * 20_000,
            b"< echo >" * 3_000,
            bytes(20_000),
        ):
            client = Client(valve)
            client.say(b"< open pve0 >")
            # the simulator may have closed it, or not read it all: it is garbage
            with contextlib.suppress(OSError):
                client.say(text)
            leave(client)
            witness.works()
    witness.saw([])


def flood(valve, witness):
    """More connections than the simulator has descriptors for; those that are there go on."""
    for leave in (Client.leave, Client.die):
        clients = []
        for _ in range(FLOOD):
            clients.append(Client(valve))
            witness.works()
        for client in clients:
            leave(client)
        witness.works()
        # there is room again: a well-behaved one gets its turn
        client = Client(valve)
        client.open()
        client.say(SEND + b"< echo >")
        equal("answer", client.hear(), b"< echo >")
        witness.saw([SENT])
        client.leave()


with connected() as valve:
    witness = Witness(valve)
    in_the_middle_of_a_message(valve, witness)
    after_a_message(valve, witness)
    nonsense(valve, witness)
    garbage(valve, witness)
    flood(valve, witness)
    witness.heard_every_heartbeat()
