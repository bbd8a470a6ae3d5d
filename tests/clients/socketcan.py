"""A stand-in on an interface of the kernel, and the kernel's own tools beside it: SUBJECT.

Runs where there is SocketCAN and the user is root, as in tests/user-mode-linux/with-can. Nothing sleeps: every wait is for a frame
or a line, with a time limit.
"""

import contextlib
import faulthandler
import os
import queue
import re
import socket
import subprocess
import sys
import tempfile
import time

from processes import process, run
from raw import hear, send
from waiting import LIFE, PATIENCE, equal, take

INTERFACE = "vcan0"

@contextlib.contextmanager
def simulator(*options):
    """A `pve-sim` that is ready: its stdin, its trace, and what it says on stderr."""
    with process(os.environ["PVE_SIM"], "--bus", f"socketcan:{INTERFACE}", "--no-http", *options) as (program, trace, said):
        ready, _ = take(trace, lambda _: True)
        assert ready.startswith(f"pve-sim ready bus=socketcan:{INTERFACE}"), ready
        take(said, lambda line: line == f"  candump {INTERFACE}")
        yield program.stdin, trace, said, ready


def raw():
    """A socket that hears and sends every frame, as (identifier with its flags, data)."""
    link = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    link.bind((INTERFACE,))
    return link


def tools():
    """can-utils: frames of both formats in both directions, each once."""
    with process("candump", "-L", INTERFACE) as (_, dump, _):

        def dumped(frame):
            return take(dump, lambda line: line.endswith(f" {INTERFACE} {frame}"))[1]

        # candump hears from when it has bound, which it does not tell
        for _ in range(PATIENCE * 2):
            run("cansend", INTERFACE, "7FF#01")
            with contextlib.suppress(queue.Empty):
                dump.get(timeout=0.5)
                break
        else:
            raise AssertionError("candump hears nothing")
        with simulator("--device", "pvea-canopen@0x22") as (_, trace, _, _):
            dumped("722#00")
            dumped("0A2#0000000000000000")
            for frame, answer in (
                ("622#4000100000000000", "5A2#4300100098010000"),
                ("1BC78822#0322F010", "1BC110F1#0462F010A5"),
                ("7E5#0401000000000000", None),
                ("7E5#5E00000000000000", "7E4#5E22000000000000"),
                ("7E5#0400000000000000", None),
                ("000#0122", None),
                ("222#08000000", "1A2#08000000"),
                ("722#R", None),
                ("622#4010100100000000", "5A2#4310100101000000"),
            ):
                run("cansend", INTERFACE, frame)
                before = dumped(frame)
                equal(f"before {frame}", before, [])
                before = dumped(answer) if answer else []
                equal(f"before {answer}", before, [])
            # each frame was in the world once: the kernel gives none of the valve's back
            last, earlier = take(trace, lambda line: "5A2#4310100101000000" in line)
            frames = [line.split()[2] for line in (*earlier, last)]
            for frame in ("722#00", "622#4000100000000000", "5A2#4300100098010000", "1A2#08000000", "722#R"):
                equal(f"in the trace: {frame}", frames.count(frame), 1)


def master():
    """python-canopen over python-can's interface of the kernel, with the EDS."""
    import canopen

    sheet = subprocess.run([os.environ["PVE_SIM"], "eds", "hat1000"], check=True, stdout=subprocess.PIPE).stdout
    with tempfile.NamedTemporaryFile(suffix=".eds") as file, simulator("--device", "hat1000@5"):
        file.write(sheet)
        file.flush()
        network = canopen.Network()
        network.connect(interface="socketcan", channel=INTERFACE)
        node = network.add_node(5, file.name)
        node.sdo.RESPONSE_TIMEOUT = PATIENCE
        try:
            for entry in node.object_dictionary.values():
                variables = entry.values() if hasattr(entry, "values") else [entry]
                for variable in variables:
                    if variable.default is not None:
                        held = variable.decode_raw(node.sdo.upload(variable.index, variable.subindex))
                        equal(f"{variable}", held, variable.default)
            pdos = queue.SimpleQueue()
            node.sdo[0x1800][5].raw = 20
            node.sdo[0x1800][1].raw = 0x185
            network.subscribe(0x185, lambda _, data, stamp: pdos.put((bytes(data), stamp)))
            node.nmt.state = "OPERATIONAL"
            stamps = [take(pdos, lambda pdo: pdo[0] == bytes(4))[0][1] for _ in range(50)]
            equal("times", stamps, sorted(stamps))
        finally:
            network.disconnect()


def j1939():
    """The kernel's stack of J1939: requests, AVC, packets in both directions."""
    VALVE, TRACTOR, ALL = 0x83, 0x27, 0xFF
    REQUEST, CLAIM, DM1, DM2, COMMANDED_ADDRESS, AVC, AVEF = 0xEA00, 0xEE00, 0xFECA, 0xFECB, 0xFED8, 0xFE33, 0xFE13
    LEVEL = 107  # SOL_CAN_J1939
    NO_FAULT = bytes.fromhex("00ff00000000ffff")

    stack = socket.socket(socket.AF_CAN, socket.SOCK_DGRAM, socket.CAN_J1939)
    stack.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
    stack.setsockopt(LEVEL, socket.SO_J1939_PROMISC, 1)
    stack.settimeout(PATIENCE)
    stack.bind((INTERFACE, socket.J1939_NO_NAME, socket.J1939_NO_PGN, TRACTOR))

    def tell(group, data, to=ALL, priority=6):
        stack.setsockopt(LEVEL, socket.SO_J1939_SEND_PRIO, priority)
        stack.sendto(data, (INTERFACE, socket.J1939_NO_NAME, group, to))

    def hear(group, wanted=lambda data: True, source=VALVE):
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            data, (_, _, its, address) = stack.recvfrom(2000)
            if (its, address) == (group, source) and wanted(data):
                return data
        raise AssertionError(f"no {group:04X} from {source:02X} as wanted")

    with simulator("--device", "pvea-isobus@0x83") as (stdin, _, _, _):
        hear(CLAIM)
        equal("AVEF", hear(AVEF).hex(), "7d7d30ffffffffff")
        tell(REQUEST, CLAIM.to_bytes(3, "little"), VALVE)
        equal("claim", hear(CLAIM).hex(), "0100200708ff0220")
        # two faults that come and go, so that DM2 takes packets
        for line, lamp in (("temperature_c 130", 0x04), ("internal_fault on", 0x10)):
            print(line, file=stdin, flush=True)
            hear(DM1, lambda data: data[0] == lamp)
        print("temperature_c 25\ninternal_fault off", file=stdin, flush=True)
        hear(DM1, lambda data: data == NO_FAULT)
        # two AVCs within the time guard end the shutdown, and DM2 has the faults then: a machine that is held up needs more
        wanted = "10fffa8f8b01f18f9001"
        deadline = time.monotonic() + PATIENCE
        told = ""
        while told != wanted and time.monotonic() < deadline:
            for _ in range(3):
                tell(AVC, bytes.fromhex("00ff30ffffffffff"), priority=3)
                hear(AVEF)
            tell(REQUEST, DM2.to_bytes(3, "little"), VALVE)
            told = hear(DM2)[:10].hex()
        equal("DM2", told, wanted)
        # packets of the kernel: the valve moves
        tell(COMMANDED_ADDRESS, bytes.fromhex("0100200708ff022085"))
        equal("claim", hear(CLAIM, source=0x85).hex(), "0100200708ff0220")


def down():
    """The interface goes down and comes back, and goes altogether and comes back: told once each."""
    read, answer = (0x622, bytes.fromhex("4000100000000000")), (0x5A2, bytes.fromhex("4300100098010000"))
    with simulator("--device", "pvea-canopen@0x22") as (_, _, said, _):

        def works(link):
            send(link, *read)
            equal("answer", hear(link, answer[0]), answer[1])

        with contextlib.closing(raw()) as link:
            works(link)
            # a heartbeat every 50 ms: there is always something to send
            send(link, 0x622, bytes.fromhex("2b17100032000000"))
            hear(link, 0x722)
        for leave, come in (
            (["link", "set", INTERFACE, "down"], [["link", "set", INTERFACE, "up"]]),
            (["link", "del", INTERFACE], [["link", "add", INTERFACE, "type", "vcan"], ["link", "set", INTERFACE, "up"]]),
        ):
            run("ip", *leave)
            warning, before = take(said, lambda line: "socketcan:" in line)
            assert warning.startswith(f"pve-sim: socketcan:{INTERFACE}: "), warning
            assert warning.endswith(": no frames are sent until this is resolved"), warning
            for command in come:
                run("ip", *command)
            with contextlib.closing(raw()) as link:
                # whether the stand-in has opened the new interface shows in its answer alone
                for _ in range(PATIENCE * 2):
                    send(link, *read)
                    with contextlib.suppress(TimeoutError):
                        equal("answer", hear(link, answer[0], patience=0.5), answer[1])
                        break
                else:
                    raise AssertionError(f"no answer after {come}")
            _, before = take(said, lambda line: re.search("sending frames again; [0-9]+ frames? w(as|ere) not sent", line))
            equal("told twice", [line for line in before if "socketcan:" in line], [])


def full():
    """A queue that is full: frames wait for room, none is lost; one that stands still holds nobody up."""
    COUNT = 300
    with simulator("--bus", "socketcand://127.0.0.1:0/pve0") as (_, _, said, ready):
        port = int(re.search(r"bus=socketcand://127\.0\.0\.1:(\d+)/pve0", ready)[1])
        client = socket.create_connection(("127.0.0.1", port))
        client.settimeout(PATIENCE)
        for text in (b"", b"< open pve0 >", b"< rawmode >"):
            client.sendall(text)
            client.recv(100)
        link = raw()

        def burst(count):
            for number in range(count):
                client.sendall(b"< send 123 2 %x %x >" % (number >> 8, number & 0xFF))
            # the answer comes when the bus has had them all
            client.sendall(b"< echo >")
            heard = b""
            while b"< echo >" not in heard:
                heard = heard[-8:] + client.recv(4096)
                assert heard, "the connection ended"

        # a dozen frames find room in the queue, and each takes 2 ms
        run("tc", "qdisc", "add", "dev", INTERFACE, "root", "tbf", "rate", "64kbit", "burst", "32", "limit", "200")
        burst(COUNT)
        numbers = [int.from_bytes(hear(link, 0x123), "big") for _ in range(COUNT)]
        equal("frames", numbers, list(range(COUNT)))

        run("tc", "qdisc", "change", "dev", INTERFACE, "root", "tbf", "rate", "8bit", "burst", "32", "limit", "200")
        burst(COUNT)
        take(said, lambda line: line.endswith(f"{INTERFACE}: the transmit queue is full and does not drain: no frames are sent until this is resolved"))
        run("tc", "qdisc", "del", "dev", INTERFACE, "root")
        burst(1)
        take(said, lambda line: re.search("sending frames again; [0-9]+ frames were not sent", line))
        while hear(link, 0x123) != bytes(2):
            pass


faulthandler.dump_traceback_later(LIFE, exit=True)
{subject.__name__: subject for subject in (tools, master, j1939, down, full)}[sys.argv[1]]()
