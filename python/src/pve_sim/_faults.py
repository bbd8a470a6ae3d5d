"""The communication faults of a bus."""

from __future__ import annotations

import threading
from types import TracebackType
from typing import Self, TypedDict
from weakref import WeakValueDictionary

from ._errors import FaultWithoutEffect, SimulatorError, UnknownDevice, WaitTimeout
from ._process import Process
from ._state import Json


class FaultLimits(TypedDict, total=False):
    """The parameters of every communication fault."""

    #: The name; by default the kind and the identifier, as in lose-220.
    name: str
    #: The maximum number of affected frames.
    count: int
    #: The probability that a frame is affected, from 0 to 1.
    probability: float
    #: The seed of the random choices.
    seed: int
    #: The time until the fault begins, in milliseconds.
    from_ms: int
    #: The duration, in milliseconds.
    for_ms: int


class FrameFault(FaultLimits, total=False):
    """The parameters of a fault that affects frames on the bus."""

    #: The bits of the identifier to compare.
    mask: int | str
    #: Whether the identifier has 29 bits; by default, its size decides.
    extended: bool
    #: The device or client whose frames are affected.
    sender: str


class DataMasks(TypedDict, total=False):
    """Bits of the data to change, first byte first; a text is in hex."""

    set: bytes | str
    clear: bytes | str
    toggle: bytes | str


class DlcMasks(TypedDict, total=False):
    """Bits of the data length code to change."""

    set: int
    clear: int
    toggle: int


class IdentifierMasks(TypedDict, total=False):
    """Bits of the identifier to change; a text is in hex."""

    set: int | str
    clear: int | str
    toggle: int | str


class CommunicationFault:
    """A communication fault, which lasts until `end`, the end of its `with` block, or the end of the simulator."""

    def __init__(self, faults: Faults, record: Json, probability: float) -> None:
        self._faults = faults
        self._struck: int = record["struck"]
        self._is_over: bool = record["is_over"]
        self._probability = probability
        #: Whether the fault has been removed from the bus, and whether its final count is unknown.
        self._is_ended = self._is_uncounted = False
        #: The name, unique among the active faults.
        self.name: str = record["name"]
        #: The fault in words: "lose 220, count 3".
        self.fault: str = record["fault"]

    @property
    def struck(self) -> int:
        """The number of affected frames so far."""
        self._update()
        return self._struck

    @property
    def is_over(self) -> bool:
        """Whether the fault has reached its count or its duration, or was ended."""
        self._update()
        return self._is_over

    def end(self) -> int:
        """Ends the fault, and returns the number of affected frames. Further calls only return the number."""
        if not self._is_ended:
            self._faults.end(self.name)
        return self._struck

    def _end_checked(self) -> FaultWithoutEffect | None:
        """Ends the fault, and returns an error if it could affect a frame and affected none."""
        if self.end() > 0 or self._probability == 0 or self._is_uncounted:
            return None
        return FaultWithoutEffect(
            f"fault {self.name} affected no frame ({self.fault}): none matched, or no time passed"
        )

    def _update(self) -> None:
        if not self._is_ended:
            self._faults.read()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        # pytest shows the line of the test instead.
        __tracebackhide__ = True
        try:
            without_effect = self._end_checked()
        except SimulatorError:
            if error is None:
                raise
            return
        # Nothing may hide the error of the block, except for a wait in vain: the test may expect it, and without an
        # effect of the fault it proves nothing.
        if without_effect is not None and (error is None or isinstance(error, WaitTimeout)):
            raise without_effect from error

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name!r}: {self.fault}>"


class Faults:
    """The faults of a simulator."""

    def __init__(self, process: Process) -> None:
        self._process = process
        #: Guards the fields below. An answer and its effect on them are one step for other threads.
        self._lock = threading.RLock()
        #: The faults that the program still references, by name.
        self._known: WeakValueDictionary[str, CommunicationFault] = WeakValueDictionary()
        #: The probabilities of the faults of this program, by name.
        self._probabilities: dict[str, float] = {}

    def add(self, request: Json) -> CommunicationFault:
        """Adds a fault."""
        with self._lock:
            # The new fault replaces a finished one with the same name, and its count.
            self.read()
            record: Json = self._process.call("POST", "/bus/faults", request)
            self._forget(record["name"])
            self._probabilities[record["name"]] = request.get("probability", 1)
            return self._fault(record)

    def read(self) -> list[CommunicationFault]:
        """Returns the faults on the bus."""
        with self._lock:
            records: list[Json] = self._process.call("GET", "/bus/faults")
            for name in set(self._known) - {record["name"] for record in records}:
                self._forget(name)
            return [self._fault(record) for record in records]

    def end(self, name: str | None = None) -> list[CommunicationFault]:
        """Ends a fault, or all, and returns them."""
        path = "/bus/faults" if name is None else f"/bus/faults/{name}"
        with self._lock:
            try:
                records: list[Json] = self._process.call("DELETE", path)
            except UnknownDevice:
                # Another client has ended it.
                records = []
            ended = [self._fault({**record, "is_over": True}) for record in records]
            for gone in [name] if name else [fault.name for fault in ended]:
                self._forget(gone)
            return ended

    def _fault(self, record: Json) -> CommunicationFault:
        """Returns the fault of a record, and updates its counts."""
        fault = self._known.get(record["name"])
        if fault is None:
            fault = self._known[record["name"]] = CommunicationFault(
                self, record, self._probabilities.get(record["name"], 1)
            )
        fault._struck, fault._is_over = record["struck"], record["is_over"]
        return fault

    def _forget(self, name: str) -> None:
        """Marks a fault as removed from the bus. Its count is final only if the fault was already over."""
        fault = self._known.pop(name, None)
        if fault is not None:
            fault._is_uncounted = not fault._is_over
            fault._is_ended = fault._is_over = True
