"""A device in pve-sim in stepped time: frames in, all frames of the bus out in their order."""

import http.client
import json
import re
import socket
import subprocess
import urllib.parse

READY = re.compile(r"pve-sim ready bus=socketcand://([^:]+):(\d+)/pve0 http=http://([^/]+)/")
FRAME = re.compile(rb"< frame ([0-9A-Fa-f]+) (\d+)\.(\d+) ([0-9A-Fa-f]*) ?>|< (echo|ok|hi) >")


class Client:
    """A client of the bus over socketcand. A sender does not hear its own frames."""

    def __init__(self, host, port):
        self.socket = socket.create_connection((host, port), timeout=60)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.buffer = b""
        self.frames = []
        for request in (b"", b"< open pve0 >", b"< rawmode >"):
            self.socket.sendall(request)
            self._until_answer()

    def _until_answer(self):
        while True:
            for match in FRAME.finditer(self.buffer):
                if match[5]:
                    self.buffer = self.buffer[match.end() :]
                    return
                seconds, fraction = int(match[2]), match[3].ljust(6, b"0")[:6]
                self.frames.append((seconds * 1_000_000 + int(fraction), int(match[1], 16) | (len(match[1]) == 8) << 31,
                                    bytes.fromhex(match[4].decode())))  # fmt: skip
            end = self.buffer.rfind(b">") + 1
            self.buffer = self.buffer[end:]
            received = self.socket.recv(1 << 16)
            if not received:
                raise EOFError("pve-sim closed the connection")
            self.buffer += received

    def send(self, frames):
        text = "".join(
            f"< send {(f'{identifier & 0x1FFFFFFF:08X}' if identifier >> 31 else f'{identifier:03X}')} {len(data)} "
            f"{data.hex(' ')} >"
            for identifier, data in frames
        )
        self.socket.sendall(text.encode() + b"< echo >")
        self._until_answer()

    def take(self):
        """Returns all frames that came until now."""
        self.socket.sendall(b"< echo >")
        self._until_answer()
        frames, self.frames = self.frames, []
        return frames


class Bus:
    """One pve-sim with one device, `dut`."""

    def __init__(self, executable, device, *options):
        self.process = subprocess.Popen(
            [executable, "--speed", "step", "--bus", "socketcand://127.0.0.1:0/pve0", "--http", "127.0.0.1:0",
             "--device", f"{device},name=dut", "--color", "never", *options],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        ready = READY.match(self.process.stdout.readline())
        if ready is None:
            raise RuntimeError(self.process.stderr.read())
        host, _, port = ready[3].rpartition(":")
        self.http = http.client.HTTPConnection(host, int(port), timeout=120)
        self.http.connect()
        self.http.sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.sender = Client(ready[1], int(ready[2]))
        self.listener = Client(ready[1], int(ready[2]))
        self.epoch = None

    def call(self, method, path, body=None):
        text = None if body is None else json.dumps(body)
        self.http.request(method, "/api/v1" + path, text, {"Content-Type": "application/json"})
        answer = self.http.getresponse()
        content = answer.read()
        if answer.status >= 300:
            raise RuntimeError(f"{method} {path} {body}: {answer.status} {content!r}")
        return json.loads(content) if content else None

    def now(self):
        return self.call("GET", "/time")["now_us"]

    def state(self):
        return self.call("GET", "/devices/dut")

    def play(self, frames, milliseconds):
        """Sends frames, lets time pass, and returns `(time, from the device, identifier, data)` in the order of the bus."""
        if frames:
            self.sender.send(frames)
        answer = self.call("POST", "/time", {"advance_ms": milliseconds})
        heard = iter(self.sender.take() + [None])
        theirs = next(heard)
        log = []
        frames = self.listener.take()
        if self.epoch is None and frames:
            self.epoch = frames[-1][0] - self.call("GET", "/trace?limit=1")[-1]["t_us"]
        for frame in frames:
            from_device = theirs == frame
            if from_device:
                theirs = next(heard)
            log.append((frame[0] - self.epoch, from_device, frame[1], frame[2]))
        return answer["now_us"], log

    def close(self):
        for client in (self.sender, self.listener):
            client.socket.close()
        self.http.close()
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()
        self.process.stderr.close()
