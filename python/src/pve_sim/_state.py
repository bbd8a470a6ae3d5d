"""States, frames, changes and conditions of the control interface. Names include the units."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypedDict

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
    #: The occurrence counter; of an angle sensor the number of entries in 0x1003. None without power.
    count: int | None


@dataclass(frozen=True)
class ValvePlant:
    """The plant of a valve."""

    supply_mv: int
    temperature_c: int
    #: The fault of the spool; None for a healthy one.
    spool: SpoolFault | None
    #: The position that the spool is pushed to by hand, -16384 to 16384; None: it is let go.
    lever: int | None
    internal_fault: bool
    memory: Memory
    #: Whether the CAN controller is kept bus-off.
    bus_off: bool


@dataclass(frozen=True)
class SensorPlant:
    """The plant of an angle sensor."""

    #: The angle of the shaft, 0 to 35999 1/100 degree.
    angle_cdeg: int
    #: Turns a minute, positive clockwise.
    speed_rpm: int
    measuring_error: bool
    internal_fault: bool
    memory: Memory
    #: Whether the CAN controller is kept bus-off.
    bus_off: bool


@dataclass(frozen=True)
class DeviceState:
    """The state of a device at one instant. Members that need power are None without."""

    #: The instant of which all of it is true, in microseconds of virtual time.
    t_us: int
    name: str
    kind: str
    #: The node ID, on ISOBUS the address, in force.
    node_id: int | None
    #: The bit rate in force, in bit/s.
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
    #: The state that AVEF tells; None on CANopen.
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
        """Returns the state in a JSON object."""
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
        """Returns the state in a JSON object."""
        plant = SensorPlant(**_fields(SensorPlant, state["plant"]))
        return cls(**_common(state), position=state["position"], plant=plant)


def _common(state: Json) -> Json:
    faults = tuple(Fault(**_fields(Fault, fault)) for fault in state["faults"])
    return {**_fields(DeviceState, state), "faults": faults}


def _fields(kind: type, values: Json) -> Json:
    """Returns the values for the fields of a class: a newer pve-sim may send more."""
    return {name: values[name] for name in kind.__dataclass_fields__}  # type: ignore[attr-defined]


class Limits(TypedDict, total=False):
    """Limits, inclusive; a missing limit does not restrict."""

    min: int
    max: int


class LedCondition(TypedDict, total=False):
    """The LED, or a part of it."""

    color: Color
    flashing: bool


class Profile(TypedDict, total=False):
    """A numeric word of the plant that changes in time."""

    word: str
    #: Times in milliseconds from now, each with a value; or a ready profile.
    points: Sequence[tuple[int, int] | list[int]] | Literal["cranking"]
    #: Each value stays until the next point; by default the values in between are interpolated.
    steps: bool


class _Change(TypedDict, total=False):
    internal_fault: bool
    memory: Memory
    bus_off: bool
    #: The duration of the change, after which the earlier values come back.
    for_ms: int
    profile: Profile


class Spool(TypedDict):
    """The spool of the control interface."""

    fault: SpoolFault | None


class ValveChange(_Change, total=False):
    """A change of the plant of a valve, as in `ValvePlant`."""

    supply_mv: int
    temperature_c: int
    spool: SpoolFault | Spool | None
    lever: int | None


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
    faults: Sequence[str]


class ValveCondition(_Condition, total=False):
    """A part of the state of a valve: equal, or within limits."""

    dsm: Dsm | None
    command: Command | None
    set_point: int | Literal["float"] | Limits | None
    position: int | Limits
    solenoids: bool
    led: LedCondition


class SensorCondition(_Condition, total=False):
    """A part of the state of an angle sensor: equal, or within limits."""

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
    #: A device by its name, `http` for frames of `Simulator.send`, or the gateway of other clients.
    sender: str
    meaning: str

    @classmethod
    def of(cls, frame: Json) -> Frame:
        """Returns the frame that a JSON object tells."""
        data = bytes.fromhex(frame["data"])
        return cls(frame["t_us"], frame["id"], frame["extended"], data, frame["from"], frame["meaning"])

    def __str__(self) -> str:
        name, data = name_of(self.id, self.extended), self.data.hex(" ").upper()
        return f"{milliseconds(self.t_us):>14}  {name:>8}: {data:23}  {self.meaning}"


@dataclass(frozen=True)
class BusError:
    """An error of the bus: a frame that is being destroyed, a change of an error mode, frames that were dropped."""

    #: When, in microseconds of virtual time.
    t_us: int
    #: Whose frame was destroyed, or who changed its error mode.
    sender: str
    meaning: str

    @classmethod
    def of(cls, error: Json) -> BusError:
        """Returns the error that a JSON object tells."""
        return cls(error["t_us"], error["from"], error["meaning"])

    def __str__(self) -> str:
        return f"{milliseconds(self.t_us):>14}  {'!!':>8}  {self.meaning}"


@dataclass(frozen=True)
class Unheard:
    """A device that runs at another bit rate than the bus, or did."""

    #: The name of the device.
    device: str
    #: The instant from which the rates differed, in microseconds of virtual time.
    t_us: int
    #: Whether they agree again.
    is_over: bool
    #: What is wrong, and the remedy.
    reason: str


@dataclass(frozen=True)
class Disturbance:
    """The frames that are going to be destroyed."""

    #: The number of attempts.
    frames: int
    #: Their identifier; None: any.
    id: int | None
    extended: bool


@dataclass(frozen=True)
class BusState:
    """The state of the bus."""

    #: The instant of which all of it is true, in microseconds of virtual time.
    t_us: int
    #: In bit/s.
    bit_rate: int
    #: How busy the bus was in the last second, in percent.
    load: int
    disturb: Disturbance
    #: The devices that run at another bit rate than the bus, and those that did for longer than a change takes.
    not_heard: tuple[Unheard, ...]

    @classmethod
    def of(cls, state: Json) -> BusState:
        """Returns the state in a JSON object."""
        disturb = Disturbance(**_fields(Disturbance, state["disturb"]))
        not_heard = tuple(Unheard(**_fields(Unheard, device)) for device in state["not_heard"])
        return cls(**{**_fields(BusState, state), "disturb": disturb, "not_heard": not_heard})


@dataclass(frozen=True)
class Event:
    """What happened: `frame`, `device` for a state that changed, `error` of the bus, or `lost` events."""

    kind: str
    #: The frame, the state, or the JSON object of the other kinds.
    value: Frame | ValveState | SensorState | Json


def state_of(state: Json) -> ValveState | SensorState:
    """Returns the state of a device of either kind."""
    return ValveState.of(state) if is_valve(state) else SensorState.of(state)


def is_valve(state: Json) -> bool:
    """Whether a state is that of a valve."""
    return "supply_mv" in state["plant"]


def digest(frames: Sequence[Frame | BusError]) -> list[str]:
    """Returns the trace as people read it: a frame that is like the last of its identifier is only counted."""
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
    """Returns the members of an identifier: a number that needs 29 bits has them, and of a text pve-sim says it."""
    if extended is None and isinstance(id, int):
        extended = id > 0x7FF
    return {"id": id} if extended is None else {"id": id, "extended": extended}


def hexadecimal(data: bytes | bytearray | str | Iterable[int]) -> str:
    """Returns data in hex, which a text is already."""
    return data.replace(" ", "") if isinstance(data, str) else bytes(data).hex()


def milliseconds(t_us: int) -> str:
    """Returns an instant as people read it."""
    return f"{t_us / 1000:.3f} ms"


def name_of(id: int, extended: bool) -> str:
    """Returns an identifier in hex, three digits or eight."""
    return f"{id:08X}" if extended else f"{id:03X}"
