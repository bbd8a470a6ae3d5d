"""A careful and a careless master, as scenario, in stepped time and as program: the same verdicts."""

from __future__ import annotations

import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

import pve_sim

ROOT = Path(__file__).parent.parent.parent
CAMPAIGNS = ROOT / "scenarios/campaigns"
sys.path.insert(0, str(ROOT / "python/examples"))

from test_master import run

KINDS = ("careful", "careless")


@dataclass(frozen=True)
class Told:
    """A cell of a row, as `pve-sim campaign` reports it."""

    fault: str
    number: int | None
    at_us: int
    verdict: str
    detected_us: int | None
    safe_us: int | None


def plan(folder: Path, kind: str, **changes: str) -> Path:
    """Writes the ready plan into a folder, with other values of some keys; an empty one removes the key."""
    text = (CAMPAIGNS / f"program-{kind}.toml").read_text(encoding="utf-8")
    for key, value in {"scenario": json.dumps(str(CAMPAIGNS / f"{kind}.toml")), **changes}.items():
        (line,) = (line for line in text.splitlines(keepends=True) if line.startswith(f"{key} = "))
        text = text.replace(line, f"{key} = {value}\n" if value else "")
    (folder / f"{kind}.toml").write_text(text, encoding="utf-8")
    return folder / f"{kind}.toml"


def scripted(folder: Path, kind: str) -> tuple[list[Told], list[Told]]:
    """Runs the plan with the scenario as controller. Returns all cells, and the worst cell of each row."""
    results = folder / f"{kind}.json"
    command = [pve_sim.find_binary(), "campaign", str(plan(folder, kind, controller="")), "--json", str(results)]
    subprocess.run([*command, "--results", str(folder / f"{kind}.jsonl")], stdout=subprocess.PIPE, check=False)
    cells, worst = [], []
    for row in json.loads(results.read_text(encoding="utf-8"))["rows"]:
        keys = ("at_us", "verdict", "detected_us", "safe_us")
        told = [Told(row["fault"], cell.get("number"), *(cell[key] for key in keys)) for cell in row["cells"]]
        cells += told
        worst.append(told[row["worst"]])
    return cells, worst


def are_near(one: int | None, other: int | None) -> bool:
    """Whether two times agree to 1 ms."""
    return one == other if one is None or other is None else abs(one - other) <= 1000


@pytest.mark.parametrize("kind", KINDS)
def test_in_stepped_time_a_master_has_the_verdicts_and_times_of_the_scenario(tmp_path: Path, kind: str) -> None:
    told, _ = scripted(tmp_path, kind)
    of_grid = {cell.number: cell for cell in told if cell.number is not None}
    cells = pve_sim.campaign(CAMPAIGNS / f"program-{kind}.toml")
    assert [cell.number for cell in cells] == list(of_grid)
    for cell in cells:
        result, wanted = cell.run(lambda sim: run(sim, careful=kind == "careful")), of_grid[cell.number]
        about = f"{cell}: {result}, not {wanted}"
        assert (str(cell), result.verdict) == (f"{wanted.fault}@{wanted.at_us / 1000:g}ms", wanted.verdict), about
        assert are_near(result.detected_us, wanted.detected_us) and are_near(result.safe_us, wanted.safe_us), about


@pytest.mark.parametrize("kind", KINDS)
def test_the_worst_instants_of_the_scenario_are_those_of_stepped_time(tmp_path: Path, kind: str) -> None:
    _, worst = scripted(tmp_path, kind)
    cells = {cell.fault: cell for cell in pve_sim.campaign(CAMPAIGNS / f"program-{kind}.toml")}
    for row, wanted in enumerate(worst):
        assert wanted.fault in cells
        # A cell of the refinement has no number.
        which = wanted.number if wanted.number is not None else f"{row}@{wanted.at_us}"
        cell = replace(cells[wanted.fault], number=which)  # type: ignore[arg-type]
        result = cell.run(lambda sim: run(sim, careful=kind == "careful"))
        assert result.verdict == wanted.verdict, f"{wanted}: {result}"
        assert are_near(result.detected_us, wanted.detected_us), f"{wanted}: {result}"
        assert are_near(result.safe_us, wanted.safe_us), f"{wanted}: {result}"


#: Cells of the programs, with their verdicts: the careless master forgets the heartbeat, and ignores an EMCY in HOLD.
CELLS = [
    ("careless", "valve: internal_fault = true@500ms", "safe-undetected"),
    ("careless", "valve: internal_fault = true@900ms", "safe-undetected"),
    ("careless", "valve: internal_fault = true@1300ms", "safe-undetected"),
    ("careless", "valve: internal_fault = true@1700ms", "safe"),
    ("careless", "valve: bus_off = true@500ms", "safe-undetected"),
    ("careless", "valve: bus_off = true@1700ms", "safe-undetected"),
    ("careless", "valve: power off@900ms", "safe-undetected"),
    ("careless", "valve: power off@1700ms", "safe-undetected"),
    ("careless", "lose 220@500ms", "no-effect"),
    ("careless", "lose 220@1700ms", "safe"),
    ("careless", "lose 1A0@900ms", "no-effect"),
    ("careless", "lose 1A0@1300ms", "no-effect"),
    ("careful", "valve: internal_fault = true@500ms", "safe"),
    ("careful", "valve: internal_fault = true@1700ms", "safe"),
    ("careful", "valve: bus_off = true@1300ms", "safe"),
    ("careful", "valve: power off@500ms", "safe"),
    ("careful", "valve: power off@1700ms", "safe"),
    ("careful", "lose 220@900ms", "safe"),
    ("careful", "lose 1A0@500ms", "safe"),
    ("careful", "lose 1A0@1700ms", "safe"),
]

#: At the speed S, a verdict survives a program that the machine holds up for 0.2 s / S. A difference that no speed
#: removes is not that of a loaded machine.
SPEEDS = (0.2, 0.05, 0.01, 0.002)


def as_program(folder: Path, kind: str, cell: pve_sim.Cell, speed: float) -> str:
    """Runs a cell with the program as controller, and returns the last line of the report."""
    folder = folder / f"{kind} {cell.number} {speed}"
    folder.mkdir()
    words = [sys.executable, str(ROOT / "python/examples/master.py"), kind, "{bus}", "{speed}"]
    path = plan(folder, kind, controller=f"{json.dumps(words)}\nspeed = {speed}")
    command = [pve_sim.find_binary(), "campaign", str(path), "--cell", str(cell.number)]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.splitlines()[-1]


def test_as_a_program_a_master_has_the_verdicts_of_the_scenario(tmp_path: Path) -> None:
    cells = {(kind, str(cell)): cell for kind in KINDS for cell in pve_sim.campaign(plan(tmp_path, kind))}
    told = {
        (kind, f"{cell.fault}@{cell.at_us / 1000:g}ms"): cell.verdict
        for kind in KINDS
        for cell in scripted(tmp_path, kind)[0]
    }

    def differs(name: tuple[str, str, str]) -> str | None:
        kind, cell, verdict = name
        assert told[kind, cell] == verdict
        for speed in SPEEDS:
            line = as_program(tmp_path, kind, cells[kind, cell], speed)
            if f": {verdict} at " in line:
                return None
        return f"{name}: {line}"

    with ThreadPoolExecutor(len(CELLS)) as pool:
        assert [line for line in pool.map(differs, CELLS) if line is not None] == []
