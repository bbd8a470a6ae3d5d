"""A device in pve-sim in stepped time: frames in, all frames of the bus out in their order."""

import json
import re
import socket
import subprocess

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
            self.until_answer()

    def until_answer(self):
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
        self.until_answer()

    def take(self):
        frames, self.frames = self.frames, []
        return frames


class Control:
    """The control interface. Its calls are on their way together: a turn of the wire takes longer than most of them."""

    def __init__(self, host, port):
        self.socket = socket.create_connection((host, port), timeout=120)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.answers = self.socket.makefile("rb")
        self.head = f" HTTP/1.1\r\nHost: {host}:{port}\r\nContent-Type: application/json\r\nContent-Length: "

    def calls(self, *calls):
        """Makes calls `(method, path[, body])`, one after the other, and returns their answers."""
        text = ""
        for method, path, *body in calls:
            content = json.dumps(body[0]) if body else ""
            text += f"{method} /api/v1{path}{self.head}{len(content)}\r\n\r\n{content}"
        self.socket.sendall(text.encode())
        answers = [self.answer() for _ in calls]
        for call, (status, content) in zip(calls, answers):
            if status >= 300:
                raise RuntimeError(f"{call}: {status} {content!r}")
        return [json.loads(content) for _, content in answers]

    def answer(self):
        status, length = self.answers.readline(), 0
        if not status:
            raise EOFError("pve-sim closed the connection")
        while (line := self.answers.readline().lower()) not in (b"\r\n", b""):
            if line.startswith(b"content-length:"):
                length = int(line[15:])
        return int(status.split()[1]), self.answers.read(length)

    def close(self):
        self.answers.close()
        self.socket.close()


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
        self.control = Control(host, int(port))
        self.sender = Client(ready[1], int(ready[2]))
        self.listener = Client(ready[1], int(ready[2]))
        self.epoch = None

    def call(self, *call):
        return self.control.calls(call)[0]

    def state(self):
        return self.call("GET", "/devices/dut")

    def play(self, frames, milliseconds):
        """Sends frames, lets time pass, and returns `(time, from the device, identifier, data)` in the order of the bus."""
        if frames:
            self.sender.send(frames)
        answer = self.call("POST", "/time", {"advance_ms": milliseconds})
        return answer["now_us"], self.heard()

    def cycle(self, frame, milliseconds, count):
        """Sends a frame that no device sends so many times, lets time pass almost until the next one, and returns as `play`."""
        extended, name = frame[0] >> 31, f"{frame[0] & 0x1FFFFFFF:X}"
        _, passed, _ = self.control.calls(
            ("POST", "/bus/frames", {"id": name, "extended": bool(extended), "data": frame[1].hex(), "every_ms": milliseconds}),
            ("POST", "/time", {"advance_ms": milliseconds * count - 2}),
            ("DELETE", f"/bus/frames?id={name}&extended={'true' if extended else 'false'}"),
        )
        # The sender hears this one: another client sends it.
        return passed["now_us"], [(at, theirs and (what, data) != frame, what, data) for at, theirs, what, data in self.heard()]

    def heard(self):
        for client in (self.sender, self.listener):
            client.socket.sendall(b"< echo >")
        for client in (self.sender, self.listener):
            client.until_answer()
        theirs = iter(self.sender.take() + [None])
        their = next(theirs)
        log = []
        frames = self.listener.take()
        if self.epoch is None and frames:
            self.epoch = frames[-1][0] - self.call("GET", "/trace?limit=1")[-1]["t_us"]
        for frame in frames:
            from_device = their == frame
            if from_device:
                their = next(theirs)
            log.append((frame[0] - self.epoch, from_device, frame[1], frame[2]))
        return log

    def close(self):
        for client in (self.sender, self.listener):
            client.socket.close()
        self.control.close()
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()
        self.process.stderr.close()
