"""The errors of this package."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ._state import SensorState, ValveState


class SimulatorError(Exception):
    """The base of all errors of this package."""


class StartError(SimulatorError):
    """pve-sim is not installed, or did not start. The text has its stderr."""


class SimulatorEnded(SimulatorError):
    """pve-sim was closed, or ended by itself. The text has its exit status and the end of its stderr."""


class Refused(SimulatorError):
    """pve-sim refused a call, and nothing changed. The text is that of pve-sim."""


class InvalidValue(Refused, ValueError):
    """An unknown field, or a value out of range."""


class Conflict(Refused):
    """A call that the present state does not allow: a frame that cannot be sent, or an advance of unstepped time."""


class UnknownDevice(SimulatorError, KeyError):
    """No device has this name. The text has the known names."""

    def __str__(self) -> str:
        # A KeyError would quote its text.
        return Exception.__str__(self)


class NotHeard(SimulatorError):
    """A device runs, or ran, at another bit rate than the bus and cannot communicate. The text has the remedy."""


class FaultWithoutEffect(SimulatorError):
    """A communication fault affected no frame within its `with` block: the test has tested nothing."""


class WaitTimeout(SimulatorError, TimeoutError):
    """A state or a frame did not come in time. The text has the last state or frame instead."""

    #: The end of the time, in microseconds of virtual time.
    t_us: int = 0
    #: The state of the device then; None when a frame was waited for.
    state: ValveState | SensorState | None = None
