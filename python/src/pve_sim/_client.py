"""A client of the bus, for python-can."""

from __future__ import annotations

import select
import socket
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from time import monotonic
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import can

from ._errors import Refused, SimulatorError

if TYPE_CHECKING:
    from ._simulator import Simulator

#: The time limit for an answer of the gateway, in seconds. It allows for a busy machine.
_ANSWER_S = 60.0

#: The time limit for the echo that orders a call after the frames of this client, in seconds. The echo does not come
#: before time advances if this client has sent more frames than the gateway accepts before they are on the bus.
_ORDER_S = 5.0


class Client(can.BusABC):
    """A client of a simulator. Unlike the socketcand client of python-can, it reports the end of the simulator.

    In stepped time, it takes part in the order of the calls: a call that changes the simulation takes effect after the
    frames that were sent before, and a call that advances time returns after the frames of this time have arrived.
    """

    def __init__(
        self,
        simulator: Simulator,
        is_stepped: bool,
        can_filters: can.typechecking.CanFilters | None = None,
        **options: Any,
    ) -> None:
        #: The simulator, which lives as long as the client.
        self.simulator = simulator
        self._process = simulator._process
        self._is_stepped = is_stepped
        self._is_closing = False
        #: Guards sending, the number of sent echoes, and whether the last one is late.
        self._sending = threading.Lock()
        self._echoes = 0
        self._is_late = False
        #: Guards the fields below, and tells of their changes. One thread reads the socket, and the others wait for it.
        self._changed = threading.Condition()
        self._is_reading = self._is_cut = False
        self._answers = 0
        self._rest = b""
        self._messages: deque[bytes] = deque()
        at = urlsplit(simulator.bus_url)
        name = at.path.strip("/")
        self.channel_info = f"pve-sim on {name}@{at.netloc}"
        self._socket = socket.create_connection((at.hostname or "", at.port or 0), _ANSWER_S)
        try:
            # An echo must not wait for the acknowledgement of the frames before it.
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._socket.settimeout(None)
            self._expect(b"< hi ")
            self._socket.sendall(f"< open {name} >".encode())
            self._expect(b"< ok ")
            self._socket.sendall(b"< rawmode >")
            self._expect(b"< ok ")
            super().__init__(channel=name, can_filters=can_filters, **options)
        except BaseException:
            self._socket.close()
            raise
        self.channel = name

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Sends a frame; `timeout` is ignored.

        Raises:
            SimulatorEnded: the simulator has ended.
        """
        id = f"{msg.arbitration_id:08X}" if msg.is_extended_id else f"{msg.arbitration_id:03X}"
        with self._sending:
            is_sent = self._write(f"< send {id} {msg.dlc:X} {msg.data.hex(' ')} >")
        if not is_sent:
            raise self._lost()

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Returns the next frame; None: no frame within `timeout` seconds.

        Raises:
            SimulatorEnded: the simulator has ended, and all its frames have been returned.
        """
        try:
            return super().recv(timeout)
        except SimulatorError:
            if self._is_closing and not self._is_shutdown:
                return None
            raise

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        while (text := self._next(timeout)) is not None:
            message = _message(text, self.channel)
            if self._matches_filters(message):
                return message, True
            timeout = 0
        return None, True

    def _next(self, timeout: float | None) -> str | None:
        self._read_until(lambda: bool(self._messages), timeout)
        with self._changed:
            if self._messages:
                return self._messages.popleft().decode()
            is_cut = self._is_cut
        if is_cut:
            raise self._lost()
        return None

    def order(self) -> None:
        """In stepped time, waits until all frames have arrived: those from this client, and those for it."""
        if not self._is_stepped or not self._sending.acquire(timeout=_ORDER_S):
            return
        try:
            # While an earlier echo is late, this one would be, too.
            if not self._is_late and self._write("< echo >"):
                self._echoes += 1
            wanted = self._echoes
        finally:
            self._sending.release()
        self._read_until(lambda: self._answers >= wanted, 0 if self._is_late else _ORDER_S)
        self._is_late = self._answers < wanted

    def shutdown(self) -> None:
        """Stops the notifiers and the periodic tasks of this client, and leaves the bus. Further calls do nothing."""
        if not self._is_closing:
            self._is_closing = True
            with suppress(OSError):
                # Wakes up the readers, so that no notifier waits for its next frame.
                self._socket.shutdown(socket.SHUT_RD)
            # Not before python-can 4.5.
            if hasattr(can.Notifier, "find_instances"):
                for notifier in can.Notifier.find_instances(self):
                    notifier.stop()
        super().shutdown()
        self._socket.close()

    def _write(self, text: str) -> bool:
        """Writes a message, with `_sending` held; returns whether the connection is up."""
        try:
            self._socket.sendall(text.encode())
        except OSError:
            return False
        return True

    def _expect(self, answer: bytes) -> None:
        """Reads the answer to a request, before any frame."""
        self._read_until(lambda: bool(self._messages), _ANSWER_S)
        if not self._messages:
            raise self._lost()
        if (said := self._messages.popleft()) != answer:
            raise Refused(f"pve-sim refused a client: {said.decode()}>")

    def _read_until(self, done: Callable[[], bool], timeout: float | None) -> None:
        """Reads until a condition holds, the time limit or the end of the stream."""
        end = None if timeout is None else monotonic() + timeout
        with self._changed:
            while not done() and not self._is_cut:
                left = None if end is None else max(0, end - monotonic())
                if self._is_reading:
                    if not self._changed.wait(left):
                        return
                    continue
                self._is_reading = True
                self._changed.release()
                data: bytes | None = b""
                try:
                    data = self._read(left)
                finally:
                    self._changed.acquire()
                    self._is_reading = False
                    self._changed.notify_all()
                if data is None:
                    return
                self._take(data)

    def _read(self, timeout: float | None) -> bytes | None:
        """Returns the next bytes; none at the end of the stream, and None after the time limit."""
        try:
            ready, _, _ = select.select([self._socket], [], [], timeout)
            return self._socket.recv(0x10000) if ready else None
        except (OSError, ValueError):
            # The socket was closed meanwhile.
            return b""

    def _take(self, data: bytes) -> None:
        """Keeps the messages of the next bytes, with `_changed` held."""
        self._is_cut = not data
        *messages, self._rest = (self._rest + data).split(b">")
        for message in messages:
            if message == b"< echo ":
                self._answers += 1
            else:
                self._messages.append(message)

    def _lost(self) -> SimulatorError:
        """Returns the error of a client without a connection."""
        if self._is_closing:
            return SimulatorError("this client of the bus was shut down")
        return self._process.ending(
            SimulatorError("pve-sim disconnected this client of the bus, which did not read its frames in time")
        )


def _message(text: str, channel: can.typechecking.Channel | None) -> can.Message:
    """Returns the frame or error frame of a message: `< frame 18A 1795223549.715344 0102 `.

    Raises:
        can.CanOperationError: the message is a refusal of a sent frame.
    """
    kind, *fields = text.removeprefix("< ").split()
    if kind not in ("frame", "error") or "." not in fields[1]:
        raise can.CanOperationError(f"pve-sim refused a frame: {' '.join(fields)}")
    id, at, *data = fields
    return can.Message(
        timestamp=float(at),
        arbitration_id=int(id, 16),
        is_extended_id=kind == "error" or len(id) > 3,
        is_error_frame=kind == "error",
        # As python-can's own client.
        data=bytes(1) if kind == "error" else bytes.fromhex("".join(data)),
        channel=channel,
        is_rx=True,
    )
