"""States, frames, changes and conditions of the control interface. Names include the units."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypedDict

from ._errors import InvalidValue

#: A JSON object.
Json = dict[str, Any]

Nmt = Literal["initialising", "pre-operational", "operational", "stopped"]
Dsm = Literal["init", "disabled", "hold", "active", "fault-hold"]
Command = Literal["blocked", "extend", "retract", "float", "hand", "emergency-stop"]
Color = Literal["green", "yellow", "red", "off"]
SpoolFault = Literal["ok", "stuck", "slow", "drifting", "no-float"]
Memory = Literal["ok", "write-fails", "damaged"]
Speed = float | Literal["step"]


@dataclass(frozen=True)
class Led:
    """The LED of a valve."""

    color: Color
    flashing: bool


@dataclass(frozen=True)
class Fault:
    """A fault of a device."""

    fault: str
    active: bool
    #: The occurrence counter; for an angle sensor, the number of entries in 0x1003. None without power.
    count: int | None


@dataclass(frozen=True)
class ValvePlant:
    """The plant of a valve."""

    supply_mv: int
    temperature_c: int
    #: The fault of the spool; None for a healthy spool.
    spool: SpoolFault | None
    #: The position to which a hand pushes the spool, -16384 to 16384; None if the lever is released.
    lever: int | None
    internal_fault: bool
    memory: Memory
    #: Whether the CAN controller is kept bus-off.
    bus_off: bool
    #: The supply below which the valve is off; None if the valve is never off.
    brown_out_mv: int | None
    #: Whether cold oil slows the spool down.
    oil: bool
    #: The time from power-up to the start of the program, in milliseconds.
    boot_ms: int
    #: The answer delay in milliseconds, or the smallest and the largest delay.
    answer_ms: int | list[int]
    #: The cycle time of the program in milliseconds; 0 if the program acts immediately.
    cycle_ms: int


@dataclass(frozen=True)
class SensorPlant:
    """The plant of an angle sensor."""

    #: The angle of the shaft, 0 to 35999 1/100 degree.
    angle_cdeg: int
    #: The speed of the shaft in turns a minute, positive clockwise.
    speed_rpm: int
    measuring_error: bool
    internal_fault: bool
    memory: Memory
    #: Whether the CAN controller is kept bus-off.
    bus_off: bool
    #: The time from power-up to the start of the program, in milliseconds.
    boot_ms: int
    #: The answer delay in milliseconds, or the smallest and the largest delay.
    answer_ms: int | list[int]
    #: The cycle time of the program in milliseconds; 0 if the program acts immediately.
    cycle_ms: int


@dataclass(frozen=True)
class DeviceState:
    """The state of a device at one instant. Fields that need power are None while the device is off."""

    #: The instant of this state, in microseconds of virtual time.
    t_us: int
    name: str
    kind: str
    #: The current node ID; on ISOBUS, the current address.
    node_id: int | None
    #: The current bit rate, in bit/s.
    bit_rate: int | None
    powered: bool
    #: The NMT state; None on ISOBUS.
    nmt: Nmt | None
    #: Every fault of the kind.
    faults: tuple[Fault, ...]

    @property
    def active_faults(self) -> tuple[str, ...]:
        """The names of the active faults."""
        return tuple(fault.fault for fault in self.faults if fault.active)


@dataclass(frozen=True)
class ValveState(DeviceState):
    """The state of a valve."""

    #: The device state machine; None on ISOBUS.
    dsm: Dsm | None
    #: The state in AVEF; None on CANopen.
    command: Command | None
    #: The last accepted set-point, -16384 to 16384.
    set_point: int | Literal["float"] | None
    #: The position of the spool, -16384 to 16384.
    position: int
    #: Whether the solenoids are energised.
    solenoids: bool
    led: Led
    plant: ValvePlant

    @classmethod
    def of(cls, state: Json) -> ValveState:
        """Returns the state from a JSON object."""
        plant = state["plant"]
        return cls(
            **_common(state),
            dsm=state["dsm"],
            command=state["command"],
            set_point=state["set_point"],
            position=state["position"],
            solenoids=state["solenoids"],
            led=Led(state["led"]["color"], state["led"]["flashing"]),
            plant=ValvePlant(**_fields(ValvePlant, {**plant, "spool": plant["spool"]["fault"]})),
        )


@dataclass(frozen=True)
class SensorState(DeviceState):
    """The state of an angle sensor."""

    #: Object 0x6004.
    position: int | None
    plant: SensorPlant

    @classmethod
    def of(cls, state: Json) -> SensorState:
        """Returns the state from a JSON object."""
        plant = SensorPlant(**_fields(SensorPlant, state["plant"]))
        return cls(**_common(state), position=state["position"], plant=plant)


def _common(state: Json) -> Json:
    faults = tuple(Fault(**_fields(Fault, fault)) for fault in state["faults"])
    return {**_fields(DeviceState, state), "faults": faults}


def _fields(kind: type, values: Json) -> Json:
    """Returns the values of the fields of a class. Other values, for example from a newer pve-sim, are ignored."""
    return {name: values[name] for name in kind.__dataclass_fields__}  # type: ignore[attr-defined]


class Limits(TypedDict, total=False):
    """Inclusive limits; a missing limit does not restrict the value."""

    min: int
    max: int


class LedCondition(TypedDict, total=False):
    """The LED, or one of its fields."""

    color: Color
    flashing: bool


class Profile(TypedDict, total=False):
    """A change of a numeric plant word over time."""

    word: str
    #: Times in milliseconds from now, each with a value; or the name of a built-in profile.
    points: Sequence[tuple[int, int] | list[int]] | Literal["cranking"]
    #: Each value stays until the next point; by default the values in between are interpolated.
    steps: bool


class _Change(TypedDict, total=False):
    internal_fault: bool
    memory: Memory
    bus_off: bool
    boot_ms: int
    answer_ms: int | Sequence[int]
    cycle_ms: int
    #: The duration of the change, after which the earlier values come back.
    for_ms: int
    profile: Profile


class Spool(TypedDict):
    """The spool, as in the JSON of the control interface."""

    fault: SpoolFault | None


class ValveChange(_Change, total=False):
    """A change of the plant of a valve, as in `ValvePlant`."""

    supply_mv: int
    temperature_c: int
    spool: SpoolFault | Spool | None
    lever: int | None
    brown_out_mv: int | None
    oil: bool


class SensorChange(_Change, total=False):
    """A change of the plant of an angle sensor, as in `SensorPlant`."""

    angle_cdeg: int
    speed_rpm: int
    measuring_error: bool


class _Condition(TypedDict, total=False):
    node_id: int | None
    bit_rate: int | None
    powered: bool
    nmt: Nmt | None
    #: The names of the active faults, exactly.
    faults: Collection[str]


class ValveCondition(_Condition, total=False):
    """A condition on the state of a valve: values are equal, or within limits."""

    dsm: Dsm | None
    command: Command | None
    set_point: int | Literal["float"] | Limits | None
    position: int | Limits
    solenoids: bool
    led: LedCondition


class SensorCondition(_Condition, total=False):
    """A condition on the state of an angle sensor: values are equal, or within limits."""

    position: int | Limits | None


@dataclass(frozen=True)
class Frame:
    """A frame that was on the bus."""

    #: The end of the frame, in microseconds of virtual time.
    t_us: int
    id: int
    #: Whether the identifier has 29 bits.
    extended: bool
    data: bytes
    #: The name of a device; `http` for `Simulator.send`; `the gateway` for other clients.
    sender: str
    meaning: str

    @classmethod
    def of(cls, frame: Json) -> Frame:
        """Returns the frame from a JSON object."""
        data = bytes.fromhex(frame["data"])
        return cls(frame["t_us"], frame["id"], frame["extended"], data, frame["from"], frame["meaning"])

    def __str__(self) -> str:
        name, data = name_of(self.id, self.extended), self.data.hex(" ").upper()
        return f"{milliseconds(self.t_us):>14}  {name:>8}: {data:23}  {self.meaning}"


@dataclass(frozen=True)
class BusError:
    """An error on the bus: a destroyed frame, a change of an error mode, or dropped frames."""

    #: The instant, in microseconds of virtual time.
    t_us: int
    #: The sender of the frame, or the node whose error mode has changed.
    sender: str
    meaning: str

    @classmethod
    def of(cls, error: Json) -> BusError:
        """Returns the error from a JSON object."""
        return cls(error["t_us"], error["from"], error["meaning"])

    def __str__(self) -> str:
        return f"{milliseconds(self.t_us):>14}  {'!!':>8}  {self.meaning}"


@dataclass(frozen=True)
class Unheard:
    """A device that runs, or ran, at a different bit rate than the bus."""

    #: The name of the device.
    device: str
    #: The instant from which the rates differed, in microseconds of virtual time.
    t_us: int
    #: Whether the rates agree again.
    is_over: bool
    #: The problem, and its remedy.
    reason: str


@dataclass(frozen=True)
class Disturbance:
    """The disturbance of the bus, which destroys the next transmission attempts."""

    #: The remaining number of attempts.
    frames: int
    #: The identifier of the frames; None for any.
    id: int | None
    extended: bool


@dataclass(frozen=True)
class BusState:
    """The state of the bus."""

    #: The instant of this state, in microseconds of virtual time.
    t_us: int
    #: The bit rate, in bit/s.
    bit_rate: int
    #: The bus load of the last second, in percent.
    load: int
    disturb: Disturbance
    #: The devices that run, or ran for more than a second, at a different bit rate than the bus.
    not_heard: tuple[Unheard, ...]

    @classmethod
    def of(cls, state: Json) -> BusState:
        """Returns the state from a JSON object."""
        disturb = Disturbance(**_fields(Disturbance, state["disturb"]))
        not_heard = tuple(Unheard(**_fields(Unheard, device)) for device in state["not_heard"])
        return cls(**{**_fields(BusState, state), "disturb": disturb, "not_heard": not_heard})


@dataclass(frozen=True)
class Event:
    """An event: `frame`; `device`, a changed state; `error`, on the bus; or `lost`, a number of lost events."""

    kind: str
    #: The frame, the state, or the JSON object of the other kinds.
    value: Frame | ValveState | SensorState | Json


def state_of(state: Json) -> ValveState | SensorState:
    """Returns the state of a device of either kind."""
    return ValveState.of(state) if is_valve(state) else SensorState.of(state)


def is_valve(state: Json) -> bool:
    """Returns whether a state is that of a valve."""
    return "supply_mv" in state["plant"]


def digest(frames: Sequence[Frame | BusError]) -> list[str]:
    """Returns the trace as lines of text. Unchanged repeats of a frame are counted, not listed."""
    kept: list[Frame | BusError] = []
    again: dict[int, list[Frame]] = {}
    place: dict[tuple[int, bool], int] = {}
    latest: dict[tuple[int, bool], Frame] = {}
    for frame in frames:
        if isinstance(frame, BusError):
            kept.append(frame)
            continue
        key = (frame.id, frame.extended)
        before = place.get(key)
        last = latest.get(key)
        latest[key] = frame
        if before is not None and last and (last.data, last.sender) == (frame.data, frame.sender):
            again.setdefault(before, []).append(frame)
        else:
            place[key] = len(kept)
            kept.append(frame)
    return [f"{frame}{_times(again.get(place))}" for place, frame in enumerate(kept)]


def _times(frames: Sequence[Frame] | None) -> str:
    return f" ({len(frames)} times more, until {milliseconds(frames[-1].t_us)})" if frames else ""


def identifier(id: int | str, extended: bool | None) -> Json:
    """Returns the JSON of an identifier. By default a number above 0x7FF has 29 bits; for a text, pve-sim decides."""
    if extended is None and isinstance(id, int):
        extended = id > 0x7FF
    return {"id": id} if extended is None else {"id": id, "extended": extended}


def hexadecimal(data: bytes | bytearray | str | Iterable[int]) -> str:
    """Returns data in hex; a text is in hex already."""
    if isinstance(data, int):
        # As bytes, a number would be so many zeros.
        raise InvalidValue(f"data is a number; accepted: bytes, such as bytes([{data}]), or a text in hex")
    try:
        return data.replace(" ", "") if isinstance(data, str) else bytes(data).hex()
    except ValueError as error:
        raise InvalidValue(f"data: {error}") from error


def milliseconds(t_us: int) -> str:
    """Returns an instant as text, in milliseconds."""
    return f"{t_us / 1000:.3f} ms"


def name_of(id: int, extended: bool) -> str:
    """Returns an identifier in hex, three digits or eight."""
    return f"{id:08X}" if extended else f"{id:03X}"
