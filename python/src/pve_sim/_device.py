"""The devices of a simulator."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast
from urllib.parse import quote

from ._errors import InvalidValue, UnknownDevice, WaitTimeout
from ._state import Json, SensorState, ValveState, milliseconds, state_of

if TYPE_CHECKING:
    from typing import Unpack

    from ._simulator import Simulator
    from ._state import SensorChange, SensorCondition, ValveChange, ValveCondition

S = TypeVar("S", ValveState, SensorState)
D = TypeVar("D")


class Device(Generic[S]):
    """A device. Its methods return the state of the device at one instant."""

    def __init__(self, simulator: Simulator, name: str, kind: str) -> None:
        # The simulator lives as long as the device.
        self._simulator: Simulator = simulator
        self._process = simulator._process
        #: The name, as in `name=`.
        self.name = name
        #: The kind, as in `--device`.
        self.kind = kind

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name!r}, {self.kind}>"

    def state(self) -> S:
        """Returns the current state."""
        return self._call("GET", "")

    def power_off(self) -> S:
        """Cuts the power."""
        return self._call("POST", "/power", {"on": False})

    def power_on(self) -> S:
        """Switches the power on; a device without power boots."""
        return self._call("POST", "/power", {"on": True})

    def reset(self) -> S:
        """Resets the processor as the watchdog does."""
        return self._call("POST", "/power", {"reset": "watchdog"})

    def _plant(self, change: Mapping[str, object]) -> S:
        if not change:
            raise InvalidValue("plant needs a change, such as memory='ok'")
        return self._call("PATCH", "/plant", change)

    def _call(self, method: str, path: str, body: object = None) -> S:
        return cast(S, state_of(self._process.call(method, f"/devices/{quote(self.name)}{path}", body)))

    def _wait(self, wanted: Mapping[str, Any], within_ms: int) -> S:
        # pytest shows the line of the test instead.
        __tracebackhide__ = True
        if not wanted:
            raise InvalidValue("wait needs a condition, such as powered=True")
        condition = {"device": self.name, "state": wanted, "within_ms": within_ms}
        answer: Json = self._process.call("POST", "/wait", condition, takes_time=True)
        if "error" not in answer:
            return cast(S, state_of(answer))
        self._process.check_heard()
        raise self._timeout(wanted, within_ms, answer)

    def _timeout(self, wanted: Mapping[str, Any], within_ms: int, answer: Json) -> WaitTimeout:
        seen: Json = dict(answer["state"])
        seen["faults"] = [fault["fault"] for fault in seen["faults"] if fault["active"]]
        differ: list[str] = [f"  {key}: {seen.get(key)!r}, waited for {value!r}" for key, value in wanted.items()]
        rest = ", ".join(f"{key} {value!r}" for key, value in seen.items() if key not in {*wanted, *_UNTOLD})
        text = f"{self.name} did not reach this state within {within_ms} ms. At {milliseconds(answer['t_us'])}:"
        error = WaitTimeout("\n".join([text, *differ, f"  and {rest}"]))
        error.t_us, error.state = answer["t_us"], state_of(answer["state"])
        return error


#: The members that the message of a timeout omits.
_UNTOLD = ("t_us", "name", "kind", "plant")


class Valve(Device[ValveState]):
    """A valve."""

    def plant(self, **change: Unpack[ValveChange]) -> ValveState:
        """Changes plant words of the valve: all of them, or none.

        `supply_mv` 0 to 100000 mV; `temperature_c` -273 to 1000 °C; `spool` "ok", "stuck", "slow", "drifting" or
        "no-float", alone or as `{"fault": …}`, or None for "ok"; `lever` the position to which a hand pushes the spool,
        -16384 to 16384, or None to release it; `internal_fault`; `memory` "ok", "write-fails" or "damaged"; `bus_off`;
        `brown_out_mv` the supply below which the valve is off, 1 to 100000 mV, or None; `oil` whether cold oil slows
        the spool down; `boot_ms` 0 to 60000 ms from power-up to the start of the program; `answer_ms` the answer delay,
        0 to 60000 ms, or a list of the smallest and the largest delay; `cycle_ms` the cycle time of the program, 0 to
        1000 ms.

        Raises:
            InvalidValue: an unknown field, or a value out of range.
        """
        fields: dict[str, object] = {**change}
        if "spool" in fields and fields["spool"] is None:
            fields["spool"] = "ok"
        return self._plant(fields)

    def wait(self, *, within_ms: int = 5000, **state: Unpack[ValveCondition]) -> ValveState:
        """Waits for a condition, and returns the state at the first instant at which it holds, possibly the current.

        Values must be equal. `position` and `set_point` also accept `{"min": …, "max": …}`, `led` accepts some of its
        fields, and `faults` is the exact set of active faults.

        Args:
            within_ms: The time limit, in milliseconds of virtual time. With `speed="step"` the call advances time.

        Raises:
            WaitTimeout: the condition did not hold within the time limit.
            InvalidValue: an unknown field, or a value that the valve can never have.
        """
        __tracebackhide__ = True
        return self._wait(state, within_ms)


class Sensor(Device[SensorState]):
    """An angle sensor."""

    def plant(self, **change: Unpack[SensorChange]) -> SensorState:
        """Changes plant words of the sensor: all of them, or none.

        `angle_cdeg` 0 to 35999 1/100 degree; `speed_rpm` -2147483648 to 2147483647 turns a minute, positive clockwise;
        `measuring_error`; `internal_fault`; `memory` "ok", "write-fails" or "damaged"; `bus_off`; `boot_ms` 0 to
        60000 ms from power-up to the start of the program; `answer_ms` the answer delay, 0 to 60000 ms, or a list of the
        smallest and the largest delay; `cycle_ms` the cycle time of the program, 0 to 1000 ms.

        Raises:
            InvalidValue: an unknown field, or a value out of range.
        """
        return self._plant(change)

    def wait(self, *, within_ms: int = 5000, **state: Unpack[SensorCondition]) -> SensorState:
        """Waits as `Valve.wait` does."""
        __tracebackhide__ = True
        return self._wait(state, within_ms)


class Devices(dict[str, D]):
    """Devices by name, in the order of their creation."""

    def __init__(self, devices: Mapping[str, D], known: list[str]) -> None:
        super().__init__(devices)
        self._known = known

    def __missing__(self, name: str) -> D:
        raise UnknownDevice(f"no device {name!r}; accepted: {', '.join(self._known)}")

    def first(self, what: str) -> D:
        """Returns the first device."""
        for device in self.values():
            return device
        raise UnknownDevice(f"the simulator has no {what}, only: {', '.join(self._known)}")
