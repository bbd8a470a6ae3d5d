"""A controller in Python against each fault of a plan at each instant, in stepped time."""

from pathlib import Path

import pytest
from master import Master

from pve_sim import Cell, Simulator

CAMPAIGNS = Path(__file__).parents[2] / "scenarios/campaigns"


def run(sim: Simulator, *, careful: bool) -> None:
    """Connects a master to a simulator. The end of the cell ends it."""
    master, due_us = Master(sim.send, careful=careful), 0
    while True:
        frame = sim.receive(min(60_000, max(0, due_us - sim.now_us()) / 1000))
        if frame is not None:
            master.hear(frame.id, frame.data, frame.t_us)
        due_us = master.poll(sim.now_us())


@pytest.mark.pve_sim_campaign(CAMPAIGNS / "program-careful.toml")
def test_the_careful_master_passes(pve_sim_cell: Cell) -> None:
    assert pve_sim_cell.run(lambda sim: run(sim, careful=True)).passed
