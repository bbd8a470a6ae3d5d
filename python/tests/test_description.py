"""The module has everything that the control interface describes of itself in OpenAPI."""

from __future__ import annotations

import inspect
import json
from dataclasses import fields
from http.client import HTTPConnection
from typing import Any, Literal, get_args
from urllib.parse import urlsplit

import pytest

from pve_sim import (
    Bus,
    BusError,
    BusState,
    Disturbance,
    Fault,
    Frame,
    Led,
    SensorPlant,
    SensorState,
    Simulator,
    Unheard,
    ValvePlant,
    ValveState,
)
from pve_sim import _faults as faults
from pve_sim import _state as types


@pytest.fixture(scope="module")
def description() -> Any:
    with Simulator(speed="step") as sim:
        at = urlsplit(sim.http_url)
        connection = HTTPConnection(at.hostname or "", at.port)
        connection.request("GET", "/api/v1/openapi.json")
        answer = json.load(connection.getresponse())
        connection.close()
        return answer


def names(*kinds: type) -> set[str]:
    return {field.name for kind in kinds for field in fields(kind)}


def keys(*kinds: type) -> set[str]:
    return {key for kind in kinds for key in kind.__annotations__}


def parameters(kind: type) -> set[str]:
    """Returns the public methods of a class, and their parameters."""
    methods = {name: getattr(kind, name) for name in vars(kind) if not name.startswith("_")}
    own = {name for method in methods.values() for name in inspect.signature(method).parameters}
    return {*methods, *own, *keys(faults.FaultLimits, faults.FrameFault)} - {"self", "id", "parameters"}


@pytest.mark.parametrize(
    ("schema", "known"),
    [
        ("DeviceState", names(ValveState, SensorState)),
        ("ValvePlant", names(ValvePlant)),
        ("EncoderPlant", names(SensorPlant)),
        ("Led", names(Led)),
        ("Fault", names(Fault)),
        ("BusState", names(BusState)),
        ("DisturbState", names(Disturbance)),
        ("NotHeard", names(Unheard)),
        ("BusTrouble", names(BusError) - {"sender"} | {"from"}),
        ("FrameRecord", names(Frame) - {"sender"} | {"from"}),
        ("PlantChange", keys(types.ValveChange, types.SensorChange)),
        # The instant, the name and the kind are known to whoever waits.
        ("StateCondition", keys(types.ValveCondition, types.SensorCondition) | {"t_us", "name", "kind"}),
        ("LedCondition", keys(types.LedCondition)),
        ("Limits", keys(types.Limits)),
        ("FrameToSend", {"id", "extended", "data", "every_ms"}),
        ("FrameToCome", {"id", "extended", "data"}),
        ("Disturb", {"frames", "id", "extended"}),
        ("PowerChange", {"on", "reset"}),
        ("Advance", {"advance_ms"}),
        ("BusChange", {"bit_rate"}),
        ("CommunicationFault", parameters(Bus)),
        ("DataMasks", keys(faults.DataMasks)),
        ("DlcMasks", keys(faults.DlcMasks)),
        ("IdentifierMasks", keys(faults.IdentifierMasks)),
        ("FaultRecord", {"name", "fault", "struck", "is_over"}),
    ],
)
def test_every_field_has_a_name(description: Any, schema: str, known: set[str]) -> None:
    assert set(description["components"]["schemas"][schema]["properties"]) == known


@pytest.mark.parametrize(
    ("schema", "known"),
    [
        ("Nmt", types.Nmt),
        ("DeviceStateMachine", types.Dsm),
        ("Command", types.Command),
        ("Color", types.Color),
        ("SpoolFaultName", types.SpoolFault),
        ("Memory", types.Memory),
        ("ResetCause", Literal["watchdog"]),
    ],
)
def test_every_value_has_a_name(description: Any, schema: str, known: Any) -> None:
    assert set(description["components"]["schemas"][schema]["enum"]) == set(get_args(known))


def test_every_call_has_a_name(description: Any) -> None:
    calls = {call["operationId"] for path in description["paths"].values() for call in path.values()}
    assert calls == {
        "listDevices",  # Simulator.devices
        "showDevice",  # Device.state
        "changePlant",  # Device.plant
        "switchPower",  # Device.power_on, power_off, reset
        "showBus",  # Simulator.bus_state
        "changeBus",  # Simulator.set_bit_rate
        "disturbBus",  # Simulator.disturb
        "sendFrame",  # Simulator.send
        "stopFrames",  # Simulator.stop
        "wait",  # Device.wait, Simulator.wait_frame
        "listFaults",  # Simulator.faults
        "addFault",  # Bus.lose, delay, repeat, swap, corrupt, insert, masquerade, destroy, omit
        "endFaults",  # Simulator.end_faults
        "endFault",  # CommunicationFault.end
        "showTime",  # Simulator.now_us
        "advanceTime",  # Simulator.advance
        "showTrace",  # Simulator.trace
        "followEvents",  # Simulator.events
        "showCell",
    }
