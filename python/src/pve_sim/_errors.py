"""The errors of this package."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ._state import SensorState, ValveState


class SimulatorError(Exception):
    """The base of all errors of this package."""


class StartError(SimulatorError):
    """pve-sim is not installed, or did not start. The message includes its stderr."""


class SimulatorEnded(SimulatorError):
    """pve-sim was closed, or ended by itself; the message then has its exit status and the end of its stderr."""


class Refused(SimulatorError):
    """pve-sim refused a call, and nothing changed. The message is that of pve-sim."""


class InvalidValue(Refused, ValueError):
    """An unknown field, or a value out of range."""


class Conflict(Refused):
    """A call that the current state does not allow, such as a frame that cannot be sent or `advance` in real time."""


class UnknownDevice(SimulatorError, KeyError):
    """No device or communication fault has this name. The message lists the known names."""

    def __str__(self) -> str:
        # A KeyError would quote its text.
        return Exception.__str__(self)


class NotHeard(SimulatorError):
    """A device runs, or ran, at a different bit rate than the bus. The message includes the remedy."""


class FaultWithoutEffect(SimulatorError):
    """A communication fault affected no frame within its `with` block or its test, which has tested nothing."""


class WaitTimeout(SimulatorError, TimeoutError):
    """An awaited state or frame did not occur in time. The message includes the last state or frame."""

    #: The instant of the time limit, in microseconds of virtual time.
    t_us: int = 0
    #: The state of the device at that instant; None after a wait for a frame.
    state: ValveState | SensorState | None = None
