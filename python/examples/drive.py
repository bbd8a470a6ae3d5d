"""Drives a valve to half its stroke, by python-can."""

import can

from pve_sim import Simulator


def message(id: int, data: str) -> can.Message:
    return can.Message(arbitration_id=id, data=bytes.fromhex(data), is_extended_id=False)


with Simulator("pvea-canopen@0x20") as sim:
    bus = sim.bus()
    bus.send(message(0x000, "0120"))  # NMT: start node 0x20
    sim.valve.wait(nmt="operational")
    bus.send_periodic(message(0x220, "0F000020"), 0.1)  # control word 0x000F, set-point 8192
    state = sim.valve.wait(position=8192)
    print(f"{state.dsm}, spool at {state.position} after {state.t_us / 1000:.0f} ms, LED {state.led.color}")
