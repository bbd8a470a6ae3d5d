"""A fault injected from pytest: the supply of a driven valve falls, and the valve shuts down in time."""

import pytest

from pve_sim import Simulator, Valve


@pytest.mark.pve_sim("pvea-canopen@0x20", speed="step")
def test_a_low_supply_shuts_the_valve_down(pve_sim: Simulator, valve: Valve) -> None:
    pve_sim.wait_frame(0x720)  # boot-up
    pve_sim.send(0x000, "01 20")  # NMT: start node 0x20
    pve_sim.send(0x220, "0F 00 00 20", every_ms=100)  # control word 0x000F, set-point 8192
    valve.wait(position=8192, led={"color": "green"})

    since = valve.plant(supply_mv=8000).t_us
    state = valve.wait(dsm="fault-hold", within_ms=3000)

    assert state.active_faults == ("supply-low",)
    assert state.t_us - since == 2_000_000
    assert not state.solenoids
