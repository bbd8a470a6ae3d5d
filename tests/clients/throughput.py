"""How many SDO reads a second, back to back: from pve-sim, and from python-canopen's own LocalNode behind a hub in Python,
with the same clients in the same run: a bare socket, and python-canopen, which takes most of the time for itself. By hand, on a machine that does nothing else:

    target/venv/bin/python tests/clients/throughput.py target/release/pve-sim
"""

import contextlib
import multiprocessing
import selectors
import socket
import subprocess
import sys
import threading
import time

import canopen
from canopen.objectdictionary import ObjectDictionary, ODVariable, datatypes

NODE_ID, BUS = 0x20, "pve0"
SECONDS = 3
#: One after the other, so often: the machine is not the same in every second.
ROUNDS = 3


def hub(port):
    """Passes frames on between its clients, as simply as Python can: no bus, no time."""
    server = socket.create_server(("127.0.0.1", 0))
    port.put(server.getsockname()[1])
    ready = selectors.DefaultSelector()
    ready.register(server, selectors.EVENT_READ)
    clients = {}
    while True:
        for key, _ in ready.select():
            if key.fileobj is server:
                client, _ = server.accept()
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                client.sendall(b"< hi >")
                ready.register(client, selectors.EVENT_READ)
                clients[client] = b""
                continue
            client = key.fileobj
            received = client.recv(4096)
            if not received:
                ready.unregister(client)
                del clients[client]
                continue
            *messages, clients[client] = (clients[client] + received).split(b">")
            for message in messages:
                words = message.split()
                if words[1] in (b"open", b"rawmode"):
                    client.sendall(b"< ok >")
                elif words[1] == b"send":
                    data = b"".join(byte.rjust(2, b"0") for byte in words[4:])
                    frame = b"< frame %s %.6f %s >" % (words[2], time.time(), data)
                    for other in clients:
                        if other is not client:
                            other.sendall(frame)


def dictionary():
    od = ObjectDictionary()
    entry = ODVariable("device type", 0x1000, 0)
    entry.data_type, entry.access_type, entry.default = datatypes.UNSIGNED32, "ro", 0x198
    od.add_object(entry)
    return od


@contextlib.contextmanager
def network(port):
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.1
    network.connect(interface="socketcand", host="127.0.0.1", port=port, channel=BUS)
    try:
        yield network
    finally:
        network.disconnect()


def local_node(port, there):
    with network(port) as bus:
        bus.create_node(NODE_ID, dictionary())
        there.set()
        threading.Event().wait()


def reads_in_a_second(read):
    for _ in range(100):
        read()
    reads, start = 0, time.monotonic()
    while time.monotonic() < start + SECONDS:
        read()
        reads += 1
    return reads / SECONDS


def by_python_canopen(port):
    with network(port) as bus:
        entry = bus.add_node(NODE_ID, dictionary()).sdo[0x1000]
        return reads_in_a_second(lambda: entry.raw)


def by_socket(port):
    with socket.create_connection(("127.0.0.1", port)) as client:
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

        def hear(word):
            received = b""
            while word not in received or not received.endswith(b">"):
                received += client.recv(4096)

        for word, request in ((b"hi", f"< open {BUS} >".encode()), (b"ok", b"< rawmode >"), (b"ok", b"")):
            hear(word)
            client.sendall(request)

        def read():
            client.sendall(b"< send 620 8 40 0 10 0 0 0 0 0 >")
            hear(b"frame 5A0 ")

        return reads_in_a_second(read)


@contextlib.contextmanager
def simulator(speed):
    command = [sys.argv[1], "--no-http", "--bus", f"socketcand://127.0.0.1:0/{BUS}", "--speed", speed]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        ready = process.stdout.readline()
        with subprocess.Popen(["cat"], stdin=process.stdout, stdout=subprocess.DEVNULL):
            yield int(ready.rsplit(":", 1)[1].split("/")[0])
            process.terminate()


if __name__ == "__main__":
    ports, there = multiprocessing.Queue(), multiprocessing.Event()
    multiprocessing.Process(target=hub, args=(ports,), daemon=True).start()
    port = ports.get()
    multiprocessing.Process(target=local_node, args=(port, there), daemon=True).start()
    there.wait()
    for _ in range(ROUNDS):
        for client in (by_socket, by_python_canopen):
            reference = client(port)
            print(f"{client.__name__}: LocalNode behind a hub {reference:.0f} a second", end="")
            for speed in ("1", "100"):
                with simulator(speed) as pve_sim:
                    reached = client(pve_sim)
                print(f", pve-sim --speed {speed} {reached:.0f} ({reached / reference:.2f} times)", end="")
            print(flush=True)
