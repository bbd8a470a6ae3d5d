"""The README as a visitor goes through it: its blocks run, and their frames do what they say."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import PATIENCE
from test_campaign import PLAN, SCENARIO

PYTHON = Path(__file__).parent.parent
BLOCKS = re.findall(
    r"^```python\n(.*?)^```$", (PYTHON / "README.md").read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
)


def run(script: str) -> str:
    """Runs a script that keeps a valve active, and returns what it printed.

    At a tenth of the speed: a client that the machine holds up for a second has not stopped.
    """
    unhurried = script.replace('Simulator("pvea-canopen@0x20")', 'Simulator("pvea-canopen@0x20", speed=0.1)')
    assert unhurried != script
    command = [sys.executable, "-c", unhurried]
    return subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, timeout=PATIENCE).stdout


def test_a_valve_is_driven() -> None:
    assert run(BLOCKS[0]) == "Led(color='green', flashing=False)\n"


@pytest.mark.parametrize("block", BLOCKS[1:3], ids=["supply", "frames"])
def test_a_fault_is_injected_from_pytest(pytester: pytest.Pytester, block: str) -> None:
    pytester.makepyfile(block)
    pytester.runpytest_subprocess().assert_outcomes(passed=1)


def test_each_cell_of_a_plan_is_a_test(pytester: pytest.Pytester) -> None:
    pytester.path.joinpath("drive.toml").write_text(SCENARIO)
    pytester.path.joinpath("plan.toml").write_text(PLAN.replace("count = [1, 20]", "count = 20"))
    pytester.makepyfile(BLOCKS[3])
    pytester.runpytest_subprocess("-n0").assert_outcomes(passed=4)


def test_the_example_drives() -> None:
    assert re.fullmatch(
        r"active, spool at 8192 after \d+ ms, LED green\n",
        run((PYTHON / "examples/drive.py").read_text(encoding="utf-8")),
    )
