"""A simulator of CAN hydraulic valves and angle sensors, controlled from Python.

with Simulator("pvea-canopen@0x20") as sim:
    bus = sim.bus()
    sim.valve.plant(supply_mv=8000)
    sim.valve.wait(dsm="fault-hold")
"""

from ._binary import find_binary
from ._bus import Bus
from ._campaign import Cell, CellResult, campaign
from ._device import Device, Devices, Sensor, Valve
from ._errors import (
    Conflict,
    FaultWithoutEffect,
    InvalidValue,
    NotHeard,
    Refused,
    SimulatorEnded,
    SimulatorError,
    StartError,
    UnknownDevice,
    WaitTimeout,
)
from ._faults import CommunicationFault
from ._simulator import Events, Simulator
from ._state import (
    BusError,
    BusState,
    DeviceState,
    Disturbance,
    Event,
    Fault,
    Frame,
    Led,
    SensorPlant,
    SensorState,
    Unheard,
    ValvePlant,
    ValveState,
)

__all__ = [
    "Bus",
    "BusError",
    "BusState",
    "Cell",
    "CellResult",
    "CommunicationFault",
    "Conflict",
    "Device",
    "DeviceState",
    "Devices",
    "Disturbance",
    "Event",
    "Events",
    "Fault",
    "FaultWithoutEffect",
    "Frame",
    "InvalidValue",
    "Led",
    "NotHeard",
    "Refused",
    "Sensor",
    "SensorPlant",
    "SensorState",
    "Simulator",
    "SimulatorEnded",
    "SimulatorError",
    "StartError",
    "Unheard",
    "UnknownDevice",
    "Valve",
    "ValvePlant",
    "ValveState",
    "WaitTimeout",
    "campaign",
    "find_binary",
]
