"""The simulator: devices on a bus, in a separate process."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from http.client import HTTPException
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self
from urllib.parse import urlencode, urlsplit
from weakref import WeakSet, WeakValueDictionary

from ._bus import Bus
from ._device import Device, Devices, Sensor, Valve
from ._errors import Conflict, InvalidValue, NotHeard, SimulatorEnded, SimulatorError, UnknownDevice, WaitTimeout
from ._faults import CommunicationFault, Faults
from ._process import Process
from ._state import (
    BusError,
    BusState,
    Event,
    Frame,
    Json,
    Speed,
    digest,
    hexadecimal,
    identifier,
    is_valve,
    milliseconds,
    state_of,
)

if TYPE_CHECKING:
    import can

#: The number of frames in the note of an exception.
_SHOWN = 12

#: The number of trace entries from which `trace_text` makes its text.
_LOOKED_AT = 1000

#: The running simulators of this process, for reports.
running: WeakSet[Simulator] = WeakSet()


class Simulator:
    """Devices on a virtual CAN bus. Runs until `close`, the end of `with`, or the end of this process.

    A simulator uses free ports, so that any number can run side by side. All times are virtual.
    """

    def __init__(
        self,
        *devices: str,
        links: Iterable[str] = (),
        speed: Speed = 1,
        bit_rate: int | str | None = None,
        seed: int | None = None,
        state: str | os.PathLike[str] | None = None,
        log: str | os.PathLike[str] | None = None,
        options: Sequence[str] = (),
        executable: str | os.PathLike[str] | None = None,
        not_heard: str | Iterable[str] = (),
    ) -> None:
        """Starts a simulator. The arguments are the options of `pve-sim run`, except for `not_heard`.

        Args:
            devices: As for `--device`, for example "pvea-canopen@0x20,name=boom"; by default one valve on CANopen.
            links: As for `--link`: in "boom=hat1000" a valve moves the shaft of a sensor.
            speed: The speed of virtual time, a factor of wall time; with "step", only `advance`, `wait`, `wait_frame`
                and `send` advance time.
            bit_rate: The rate of the bus in bit/s; by default that of the first device.
            seed: The seed of all random values.
            state: The folder of the devices' non-volatile memory; by default, memory is lost at the end.
            log: The file to which every frame is written.
            options: Further options of the command.
            executable: The command; by default that of the environment variable `PVE_SIM`, of this package, or in PATH.
            not_heard: The devices, a name or several, that may run at a different bit rate than the bus.

        Raises:
            StartError: the command was not found, or did not start; the message includes its stderr.
            NotHeard: a device runs at a different bit rate than the bus.
        """
        arguments = ["run", "--bus", "socketcand://127.0.0.1:0/pve0", "--http", "127.0.0.1:0", "--color", "never"]
        values = {"--speed": speed, "--bit-rate": bit_rate, "--seed": seed, "--state": state, "--log": log}
        for device in devices:
            arguments += ["--device", device]
        for link in links:
            arguments += ["--link", link]
        for option, value in values.items():
            if value is not None:
                arguments += [option, str(value)]
        self._process = Process([*arguments, *options], None if executable is None else os.fspath(executable))
        self._faults = Faults(self._process)
        self._process.not_heard = frozenset([not_heard] if isinstance(not_heard, str) else not_heard)
        try:
            states: list[Json] = self._process.call("GET", "/devices")
            unknown = self._process.not_heard - {state["name"] for state in states}
            if unknown:
                raise UnknownDevice(f"not_heard: no device {', '.join(sorted(unknown))}")
            self._process.check_heard()
        except BaseException:
            with suppress(SimulatorEnded):
                self._process.close()
            raise
        self._kinds = {state["name"]: (state["kind"], is_valve(state)) for state in states}
        # A device keeps its simulator, and not the other way round: without a cycle, the last reference ends the process.
        self._devices: WeakValueDictionary[str, Valve | Sensor] = WeakValueDictionary()
        running.add(self)

    # Devices.

    @property
    def valves(self) -> Devices[Valve]:
        """The valves by name."""
        return Devices({name: it for name, it in self.devices.items() if isinstance(it, Valve)}, list(self._kinds))

    @property
    def sensors(self) -> Devices[Sensor]:
        """The angle sensors by name."""
        return Devices({name: it for name, it in self.devices.items() if isinstance(it, Sensor)}, list(self._kinds))

    @property
    def devices(self) -> Devices[Valve | Sensor]:
        """All devices by name, in the order of the start."""
        return Devices({name: self._device(name) for name in self._kinds}, list(self._kinds))

    def _device(self, name: str) -> Valve | Sensor:
        device = self._devices.get(name)
        if device is None:
            kind, is_valve = self._kinds[name]
            device = self._devices[name] = (Valve if is_valve else Sensor)(self, name, kind)
        return device

    @property
    def valve(self) -> Valve:
        """The first valve."""
        return self.valves.first("valve")

    @property
    def sensor(self) -> Sensor:
        """The first angle sensor."""
        return self.sensors.first("angle sensor")

    def __getitem__(self, name: str) -> Valve | Sensor:
        return self.devices[name]

    # The bus.

    @property
    def bus_url(self) -> str:
        """The URL of the bus, as in `--bus`, with its port."""
        return self._process.buses[0]

    @property
    def http_url(self) -> str:
        """The URL of the control interface and of the panel."""
        return self._process.http

    @property
    def can_options(self) -> dict[str, Any]:
        """The arguments of `can.Bus` and `canopen.Network.connect` to join the bus."""
        at = urlsplit(self.bus_url)
        return {"interface": "socketcand", "host": at.hostname, "port": at.port, "channel": at.path.strip("/")}

    @property
    def bus(self) -> Bus:
        """The bus: `sim.bus()` returns a python-can client, `sim.bus.lose(0x220)` adds a communication fault."""
        return Bus(self._faults, self._join)

    def _join(self, **options: Any) -> can.BusABC:
        try:
            from ._client import Client
        except ImportError as error:
            raise SimulatorError("a client of the bus needs python-can: pip install python-can") from error
        client = Client(self, self._process.call("GET", "/time")["speed"] == "step", **options)
        self._process.clients.add(client)
        return client

    def faults(self) -> list[CommunicationFault]:
        """Returns the communication faults, including those that have reached their count or duration."""
        return self._faults.read()

    def end_faults(self) -> list[CommunicationFault]:
        """Ends all communication faults, and returns them."""
        return self._faults.end()

    def bus_state(self) -> BusState:
        """Returns bit rate, load and disturbance of the bus."""
        return BusState.of(self._process.call("GET", "/bus"))

    def set_bit_rate(self, bit_rate: int) -> BusState:
        """Changes the bit rate of the bus and of every client, in bit/s, like a master that changes its rate."""
        return BusState.of(self._process.call("PATCH", "/bus", {"bit_rate": bit_rate}))

    def disturb(self, frames: int, id: int | str | None = None, *, extended: bool | None = None) -> BusState:
        """Destroys the next transmission attempts, of one identifier or of any; replaces an earlier disturbance.

        32 destroyed attempts in a row take a sender bus-off; 0 ends the disturbance.
        """
        body: Json = {"frames": frames}
        if id is not None:
            body |= identifier(id, extended)
        elif extended is not None:
            raise InvalidValue("extended is only valid together with id")
        return BusState.of(self._process.call("POST", "/bus/disturb", body))

    # Frames.

    def send(
        self,
        id: int | str,
        data: bytes | bytearray | str | Iterable[int] = b"",
        *,
        extended: bool | None = None,
        every_ms: int | None = None,
    ) -> int:
        """Sends a frame as a client, and returns the instant of its end on the bus, in microseconds.

        Args:
            id: The identifier; a text is in hex: "220".
            data: Up to eight bytes; a text is in hex: "0F 00 00 20".
            extended: Whether the identifier has 29 bits; by default, for a number above 0x7FF and for a text of eight
                digits.
            every_ms: The period of a cyclic frame, which replaces an earlier one with the same identifier.

        Raises:
            Conflict: the frame was not sent within 1 s, and was withdrawn.
        """
        body: Json = {**identifier(id, extended), "data": hexadecimal(data)}
        if every_ms is not None:
            body["every_ms"] = every_ms
        try:
            sent: int = self._process.call("POST", "/bus/frames", body, takes_time=True)["t_us"]
        except Conflict:
            self._process.check_heard()
            raise
        return sent

    def stop(self, id: int | str | None = None, *, extended: bool | None = None) -> int:
        """Stops the cyclic frames with an identifier, or all, and returns their number."""
        if id is None and extended is not None:
            raise InvalidValue("extended is only valid together with id")
        query: Json = {} if id is None else identifier(id, extended)
        if isinstance(id, int):
            query["id"] = f"{id:X}"
        of = "?" + urlencode({key: str(value).lower() for key, value in query.items()}) if query else ""
        stopped: int = self._process.call("DELETE", f"/bus/frames{of}")["stopped"]
        return stopped

    def wait_frame(
        self,
        id: int | str,
        data: bytes | bytearray | str | Iterable[int] | None = None,
        *,
        extended: bool | None = None,
        within_ms: int = 5000,
    ) -> Frame:
        """Waits for the next frame with this identifier and this data.

        Args:
            id: The identifier; a text is in hex.
            data: The exact data; by default any. A text is in hex, as in a scenario: ".." at its end stands for any
                further bytes, "?" for any digit: "12 34 ..".
            extended: As in `send`.
            within_ms: The time limit, in milliseconds of virtual time.

        Raises:
            WaitTimeout: the frame did not occur in time. The message includes the last other frame with the identifier.
        """
        __tracebackhide__ = True
        frame = identifier(id, extended)
        if data is not None:
            frame["data"] = hexadecimal(data)
        wanted = {"frame": frame, "within_ms": within_ms}
        answer: Json = self._process.call("POST", "/wait", wanted, takes_time=True)
        if "error" not in answer:
            return Frame.of(answer)
        self._process.check_heard()
        error = WaitTimeout(f"{answer['error']}, within {within_ms} ms, until {milliseconds(answer['t_us'])}")
        error.t_us = answer["t_us"]
        raise error

    def receive(self, within_ms: float = 5000) -> Frame | None:
        """Returns the next frame that a controller in stepped time receives; None: no frame in time.

        Each frame is returned once, from the start on: also a frame that ended during another call, no frame of `send`,
        and none that a communication fault loses for all receivers. The last 4096 frames are kept.

        Args:
            within_ms: The time limit, in milliseconds of virtual time; a fraction is rounded to microseconds.
        """
        wanted = {"received": True, "within_ms": within_ms}
        answer: Json = self._process.call("POST", "/wait", wanted, takes_time=True)
        return None if "error" in answer else Frame.of(answer)

    def trace(self, limit: int = 100) -> list[Frame | BusError]:
        """Returns the last frames and errors of the bus, oldest first; 4096 are kept."""
        entries: list[Json] = self._process.call("GET", f"/trace?limit={limit}")
        return [Frame.of(entry) if "id" in entry else BusError.of(entry) for entry in entries]

    def trace_text(self, limit: int = 30) -> str:
        """Returns the last frames and their meanings as text; for a simulator that has ended, its last printed lines.

        Unchanged repeats of a frame are counted, not listed.
        """
        try:
            return "\n".join(digest(self.trace(_LOOKED_AT))[-limit:])
        except SimulatorError:
            return "".join(self._process.printed(limit)).rstrip()

    def events(self) -> Events:
        """Returns the stream of events, which begins with the states of all devices."""
        return Events(self._process)

    # Time.

    def now_us(self) -> int:
        """Returns the time since the start, in microseconds."""
        now: int = self._process.call("GET", "/time")["now_us"]
        return now

    def advance(self, ms: int) -> int:
        """Advances time by `ms` milliseconds, and returns the new time in microseconds.

        Raises:
            Conflict: the simulator does not run with `speed="step"`.
        """
        now: int = self._process.call("POST", "/time", {"advance_ms": ms}, takes_time=True)["now_us"]
        return now

    # The end.

    @property
    def pid(self) -> int:
        """The ID of the process."""
        return self._process.pid

    def check_heard(self) -> None:
        """Checks that every device runs, and has always run, at the bit rate of the bus; a change may take a second.

        The start, a wait that times out, and the end of the simulator check this, too.

        Raises:
            NotHeard: a device runs, or ran, at another rate, and `not_heard` does not name it. Each device is reported
                once.
        """
        self._process.check_heard()

    def close(self) -> None:
        """Shuts down the clients of `bus` and ends the process after all devices have stored their memory.

        Further calls do nothing.

        Raises:
            NotHeard: a device ran at another bit rate; the process has ended nevertheless.
            SimulatorEnded: the process had ended by itself, or a memory or the log is incomplete.
        """
        deaf: NotHeard | None = None
        try:
            if self in running and not self._process.has_died():
                self._process.check_heard()
        except NotHeard as error:
            deaf = error
        except SimulatorError:
            # The process has ended meanwhile; the end reports it.
            pass
        try:
            self._end()
        finally:
            if deaf is not None:
                raise deaf

    def _end(self) -> None:
        running.discard(self)
        try:
            for client in list(self._process.clients):
                client.shutdown()
        finally:
            self._process.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
            return
        if isinstance(error, Exception):
            error.add_note(f"The last frames of pve-sim:\n{self.trace_text(_SHOWN)}")
        # Nothing may hide the error of the block.
        with suppress(SimulatorError):
            self._end()

    def __repr__(self) -> str:
        return f"<Simulator {', '.join(self._kinds)} at {self.bus_url}>"


class Events(Iterator[Event]):
    """The stream of events, from the call until it or the simulator is closed. If pve-sim ends, it raises an error."""

    def __init__(self, process: Process) -> None:
        self._process = process
        self._is_closed = False
        self._connection, self._lines = process.open("/events")

    def __next__(self) -> Event:
        kind = ""
        while line := self._line():
            field, _, value = line.decode().rstrip("\r\n").partition(": ")
            if field == "event":
                kind = value
            elif field == "data":
                return _event(kind, json.loads(value))
        if not self._is_closed:
            ended = self._process.ending(SimulatorError("pve-sim has ended the stream of events"))
            if not self._process.is_closed:
                raise ended
            self.close()
        raise StopIteration

    def _line(self) -> bytes:
        """Returns the next line; none at the end of the stream."""
        try:
            line = self._lines.readline()
        except (OSError, HTTPException, ValueError):
            # The simulator has ended, or `close` was called meanwhile.
            return b""
        return line if line.endswith(b"\n") else b""

    def close(self) -> None:
        """Closes the stream."""
        self._is_closed = True
        self._lines.close()
        self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _event(kind: str, value: Json) -> Event:
    if kind == "frame":
        return Event(kind, Frame.of(value))
    return Event(kind, state_of(value) if kind == "device" else value)


__all__ = ["Device", "Events", "Simulator", "running"]
