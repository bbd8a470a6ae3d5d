"""The process of pve-sim: start, calls over HTTP, and a guaranteed end."""

from __future__ import annotations

import json
import os
import queue
import re
import signal
import subprocess
import sys
import threading
import weakref
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from http.client import HTTPConnection, HTTPException, HTTPResponse
from typing import IO, TYPE_CHECKING, Any
from urllib.parse import urlsplit
from weakref import WeakSet

from ._binary import find_binary
from ._errors import (
    Conflict,
    InvalidValue,
    NotHeard,
    Refused,
    SimulatorEnded,
    SimulatorError,
    StartError,
    UnknownDevice,
)

if TYPE_CHECKING:
    from ._client import Client

#: The time limits for the ready line, for an answer that takes no virtual time, and for the end of the process, in
#: seconds. They allow for a busy machine.
_START_S = 120.0
_ANSWER_S = 60.0
_END_S = 10.0

#: The time from a broken connection to the end of the process, in seconds.
_ENDING_S = 2.0

#: The number of kept lines of stdout, and of stderr.
_KEPT = 200

_READY = re.compile(r"pve-sim ready (?P<buses>(?:bus=\S+ )+)http=(?P<http>\S+)\s*$")


class Process:
    """A running pve-sim. It ends with `close`, with its last reference, or with this process."""

    def __init__(self, arguments: Sequence[str], executable: str | None) -> None:
        command = [executable or find_binary(), *arguments]
        #: Whether `close` was called.
        self.is_closed = False
        #: The python-can clients of the bus.
        self.clients: WeakSet[Client] = WeakSet()
        #: The devices that may run at a different bit rate than the bus, and those already reported.
        self.not_heard: frozenset[str] = frozenset()
        # pve-sim has a separate process group, because Ctrl-C goes to all processes of the terminal's group, and this
        # process may still need the simulator. If this process is killed, the broken pipe of stdout ends pve-sim. The
        # parent-death signal of Linux is not used: the end of the thread that started pve-sim would send it.
        apart: dict[str, Any] = {"start_new_session": True}
        if sys.platform == "win32":
            apart = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
        try:
            self._popen = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                text=True, encoding="utf-8", errors="replace", **apart,
            )  # fmt: skip
        except OSError as error:
            raise StartError(f"{command[0]}: {error.strerror or error}") from error
        first: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._stdout = _Drain(self._popen.stdout, first)
        self._stderr = _Drain(self._popen.stderr)
        self._end = weakref.finalize(self, _end, self._popen, [self._stdout.thread, self._stderr.thread])
        try:
            ready = _READY.match(self._first_line(first))
            if ready is None:
                raise StartError(
                    f"{command[0]} is not pve-sim, or another version: its first line is not the ready line"
                )
            self.buses = [bus.removeprefix("bus=") for bus in ready["buses"].split()]
            self.http = ready["http"]
        except BaseException:
            self._end()
            raise

    def _first_line(self, first: queue.SimpleQueue[str]) -> str:
        try:
            line = first.get(timeout=_START_S)
        except queue.Empty:
            raise StartError(f"pve-sim was not ready within {_START_S:g} s") from None
        if line:
            return line
        status = self._popen.wait()
        self._stderr.thread.join(_ENDING_S)
        raise StartError(f"pve-sim did not start ({_meaning(status)}): {self._stderr.text() or 'stderr is empty'}")

    @property
    def pid(self) -> int:
        """The process ID."""
        return self._popen.pid

    def has_died(self) -> bool:
        """Whether the process ended before `close`."""
        return not self.is_closed and self._popen.poll() is not None

    def close(self) -> None:
        """Ends the process; the devices store their memory first. Further calls do nothing.

        Raises:
            SimulatorEnded: the process had ended by itself, or did not store everything.
        """
        if self.is_closed:
            return
        died = self.ended() if self.has_died() else None
        self.is_closed = True
        failure = self._end()
        if died is not None:
            raise died
        if failure is not None:
            raise SimulatorEnded(f"{failure}; its stderr:\n{self._said()}")

    def ended(self) -> SimulatorEnded:
        """Returns the error of a call to a simulator that has ended."""
        if self.is_closed:
            return SimulatorEnded("the simulator is closed")
        status = self._popen.wait()
        return SimulatorEnded(f"pve-sim ended by itself ({_meaning(status)}); its stderr:\n{self._said()}")

    def _said(self) -> str:
        """Returns the last lines of stderr of a process that has ended."""
        self._stderr.thread.join(_ENDING_S)
        return "".join(self._stderr.last(10)).strip()

    def printed(self, lines: int) -> list[str]:
        """Returns the last lines of stdout; for a process that has ended, including its last line."""
        if self._popen.poll() is not None:
            self._stdout.thread.join(_ENDING_S)
        return self._stdout.last(lines)

    def call(self, method: str, path: str, body: object = None, *, takes_time: bool = False) -> Any:
        """Returns the answer to a call, including status 408. A call that takes virtual time has no time limit."""
        if method != "GET":
            self._order()
        connection = self._connection(None if takes_time else _ANSWER_S)
        try:
            answer = self._ask(connection, method, path, body)
            text = answer.read()
        except (OSError, HTTPException) as error:
            raise self._unanswered(method, path, error) from error
        finally:
            connection.close()
        if takes_time:
            self._order()
        if answer.status in (200, 408):
            return json.loads(text)
        raise self._refused(answer.status, text)

    def _order(self) -> None:
        for client in list(self.clients):
            client.order()

    def check_heard(self) -> None:
        """Raises `NotHeard` for unreported devices that run, or ran, at a different bit rate than the bus."""
        __tracebackhide__ = True
        devices = self.call("GET", "/bus")["not_heard"]
        told = [device for device in devices if device["device"] not in self.not_heard]
        if told:
            self.not_heard |= {device["device"] for device in told}
            raise NotHeard("\n".join(device["reason"] for device in told))

    def open(self, path: str) -> tuple[HTTPConnection, HTTPResponse]:
        """Returns the streaming answer to a GET, and its connection."""
        connection = self._connection(None)
        try:
            answer = self._ask(connection, "GET", path, None)
            if answer.status == 200:
                return connection, answer
            refused = self._refused(answer.status, answer.read())
        except (OSError, HTTPException) as error:
            refused = self._unanswered("GET", path, error)
        connection.close()
        raise refused

    def _connection(self, timeout: float | None) -> HTTPConnection:
        if self.is_closed or self._popen.poll() is not None:
            raise self.ended()
        at = urlsplit(self.http)
        return HTTPConnection(at.hostname or "", at.port, timeout=timeout)

    @staticmethod
    def _ask(connection: HTTPConnection, method: str, path: str, body: object) -> HTTPResponse:
        # A set of names is a list in JSON.
        data = None if body is None else json.dumps(body, default=list)
        connection.request(method, f"/api/v1{path}", data, {"Content-Type": "application/json"})
        return connection.getresponse()

    def _refused(self, status: int, text: bytes) -> SimulatorError:
        """Returns the error of an answer. Status 503 means an exhausted capacity, or a simulator that is ending."""
        refusal = _refusal(status, json.loads(text)["error"])
        return self.ending(refusal) if status == 503 else refusal

    def _unanswered(self, method: str, path: str, error: Exception) -> SimulatorError:
        return self.ending(SimulatorError(f"{method} {path}: pve-sim did not answer: {error}"))

    def ending(self, otherwise: SimulatorError) -> SimulatorError:
        """Returns the error of an ended simulator if it ends soon, because its connections break before it exits."""
        try:
            if not self.is_closed:
                self._popen.wait(timeout=_ENDING_S)
        except subprocess.TimeoutExpired:
            return otherwise
        return self.ended()


class _Drain:
    """Reads a pipe in a thread, so that the pipe never fills up, and keeps its last lines."""

    def __init__(self, pipe: IO[str] | None, first: queue.SimpleQueue[str] | None = None) -> None:
        self._lines: deque[str] = deque(maxlen=_KEPT)
        self._lock = threading.Lock()
        arguments = (pipe, self._lines, self._lock, first)
        self.thread = threading.Thread(target=_drain, args=arguments, name="pve-sim", daemon=True)
        self.thread.start()

    def last(self, lines: int) -> list[str]:
        with self._lock:
            return list(self._lines)[-lines:]

    def text(self) -> str:
        return "".join(self.last(_KEPT)).strip()


def _drain(pipe: IO[str], lines: deque[str], lock: threading.Lock, first: queue.SimpleQueue[str] | None) -> None:
    with pipe:
        if first is not None:
            first.put(pipe.readline())
        for line in pipe:
            with lock:
                lines.append(line)


def _end(popen: subprocess.Popen[str], drains: list[threading.Thread]) -> str | None:
    """Ends a process, and returns its failure. Does nothing in a fork of the process that started it.

    The command may be a script that runs pve-sim: the whole group is asked to end, and killed.
    """
    asked = _ask_to_end(popen)
    failure = None
    try:
        status = popen.wait(timeout=_END_S)
        # A script that runs pve-sim ends by the signal.
        if asked and status not in (0, -signal.SIGTERM):
            failure = f"pve-sim did not end without an error ({_meaning(status)})"
    except subprocess.TimeoutExpired:
        failure = f"pve-sim did not end within {_END_S:g} s and was killed"
        _kill(popen)
        popen.wait()
    for drain in drains:
        drain.join(_END_S)
    if any(drain.is_alive() for drain in drains):
        # The script has ended, and pve-sim has not.
        _kill(popen)
        for drain in drains:
            drain.join(_ENDING_S)
    return failure


def _ask_to_end(popen: subprocess.Popen[str]) -> bool:
    """Asks a process to end after all devices have stored their memory; returns whether it was there, and could be."""
    if popen.poll() is not None:
        return False
    if sys.platform == "win32":
        try:
            # Only this process receives the event, because it is a group of its own.
            popen.send_signal(signal.CTRL_BREAK_EVENT)
        except OSError:
            # Neither process has a console.
            popen.terminate()
            return False
    else:
        with suppress(OSError):
            os.killpg(popen.pid, signal.SIGTERM)
    return True


def _kill(popen: subprocess.Popen[str]) -> None:
    if sys.platform == "win32":
        popen.kill()
    else:
        with suppress(OSError):
            os.killpg(popen.pid, signal.SIGKILL)


def _meaning(status: int) -> str:
    return f"signal {-status}" if status < 0 else f"exit status {status}"


def _refusal(status: int, error: str) -> SimulatorError:
    if status == 400:
        return InvalidValue(error)
    if status == 404:
        return UnknownDevice(error)
    return Conflict(error) if status == 409 else Refused(error)
