"""Campaigns: cells in stepped time, with a controller in Python, and their verdicts."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

import pve_sim
from pve_sim import Simulator, WaitTimeout

SCENARIO = """
devices = ["pvea-canopen@0x20,name=valve"]
steps = [
  { expect = "720#00" },
  { send = "000#0100" },
  { send = "220#0F00 0010", every_ms = 50 },
  { at_ms = 1000, expect = { dsm = "active" } },
]
"""

PLAN = """
scenario = "drive.toml"
faults = [{ plant = { supply_mv = 8000 } }, { lose = "220", count = [1, 20], reference = "loss" }]
instants = { from_ms = 500, to_ms = 520, step_ms = 20 }
detected = { expect = "000#0220", within_ms = 2010 }
safe = { expect = { dsm = "fault-hold", solenoids = false }, within_ms = 2100 }
"""


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    (tmp_path / "drive.toml").write_text(SCENARIO)
    (tmp_path / "plan.toml").write_text(PLAN)
    return tmp_path / "plan.toml"


def careless(sim: Simulator) -> None:
    """Drives the valve, and listens to nobody."""
    sim.wait_frame(0x720)
    sim.send(0x000, "0100")
    sim.send(0x220, "0F00 0010", every_ms=50)


def careful(sim: Simulator) -> None:
    """Drives the valve, and stops it after an EMCY."""
    careless(sim)
    while True:
        try:
            sim.wait_frame(0x0A0, "?? ?? ?? 01 ..", within_ms=10_000)
            sim.send(0x000, "0220")
        except WaitTimeout:
            pass


def test_verdicts_are_those_of_the_scripted_master_to_the_microsecond(plan: Path) -> None:
    cells = pve_sim.campaign(plan)
    assert [str(cell) for cell in cells] == [
        f"{fault}@{at}ms"
        for fault in ("valve: supply_mv = 8000", "lose 220, count 1", "lose 220, count 20")
        for at in (500, 520)
    ]
    assert cells[2].reference == "loss"
    for cell in cells:
        mine = cell.run(careless)
        command = [pve_sim.find_binary(), "campaign", str(plan), "--cell", str(cell.number)]
        told = subprocess.run(command, capture_output=True, text=True, check=False).stdout.splitlines()[-1]
        assert f": {mine.verdict} at " in told
        if mine.safe_us is not None:
            assert f"safe after {mine.safe_us // 1000}.{mine.safe_us % 1000:03} ms" in told


def test_a_careful_controller_is_seen_to_detect(plan: Path) -> None:
    supply, *_, lost = pve_sim.campaign(plan)
    result = supply.run(careful)
    assert result.verdict == "safe"
    assert result.passed
    assert result.detected_us is not None
    assert 2_000_000 < result.detected_us < 2_002_000
    assert (result.safe_us, result.struck) == (2_000_000, 1)
    missed = supply.run(careless)
    assert not missed.passed
    # Also without `.passed`.
    assert result
    assert not missed
    assert lost.run(careful).struck == 20


def test_a_fault_that_does_not_act_proves_nothing(plan: Path) -> None:
    plan.write_text(PLAN.replace('lose = "220", count', 'lose = "7FF", count'))
    result = pve_sim.campaign(plan)[2].run(careful)
    assert (result.verdict, result.struck, result.passed) == ("not-injected", 0, False)


def test_a_proof_that_holds_before_the_fault_proves_nothing(plan: Path) -> None:
    def stops(sim: Simulator) -> None:
        careless(sim)
        sim.send(0x000, "0220", every_ms=5)

    for cell in pve_sim.campaign(plan)[1::2]:
        result = cell.run(stops)
        reason = "detected: the proof holds without a fault, at 504 ms (seed 1), and so proves nothing"
        assert (result.verdict, result.reason) == ("not-injected", reason), cell
        assert cell.run(careful).reason is None


def test_a_controller_receives_each_frame_once_and_no_lost_one(plan: Path) -> None:
    with Simulator("pvea-canopen@0x20", speed="step") as sim:
        sim.advance(50)
        with sim.bus.lose(0x5A0):
            sim.send(0x620, "4018 1001 0000 0000")
            assert [frame.id for frame in iter(lambda: sim.receive(5), None)] == [0x720, 0x0A0]
        start = sim.now_us()
        assert sim.receive(0.25) is None
        assert sim.now_us() == start + 250


def test_a_controller_that_fails_hangs(plan: Path) -> None:
    def fails(sim: Simulator) -> None:
        sim.advance(100)
        raise ZeroDivisionError

    result = pve_sim.campaign(plan)[0].run(fails)
    assert result.verdict == "hung"
    assert isinstance(result.error, ZeroDivisionError)
    assert not result.passed


def test_a_check_that_fails_after_the_verdict_fails_the_test(plan: Path) -> None:
    def checks(sim: Simulator) -> None:
        try:
            careful(sim)
        finally:
            raise AssertionError("the controller's own check")

    def fails(sim: Simulator) -> None:
        try:
            careful(sim)
        finally:
            raise ZeroDivisionError

    supply = pve_sim.campaign(plan)[0]
    with pytest.raises(AssertionError, match="own check"):
        supply.run(checks)
    result = supply.run(fails)
    assert (result.verdict, type(result.error)) == ("safe", ZeroDivisionError)
    assert supply.run(careful).error is None


def test_a_plan_that_cannot_be_read_is_refused(plan: Path) -> None:
    plan.write_text(PLAN.replace("faults", "fault"))
    with pytest.raises(pve_sim.InvalidValue, match=r"plan.toml:3: .*did you mean 'faults'"):
        pve_sim.campaign(plan)
    with pve_sim.Simulator(speed="step") as sim, pytest.raises(pve_sim.Conflict, match="--plan"):
        sim._process.call("GET", "/cell")


def test_each_cell_is_a_test_with_a_readable_id(plan: Path, pytester: pytest.Pytester) -> None:
    pytester.makepyfile(f"""
        import pytest

        @pytest.mark.pve_sim_campaign({str(plan)!r})
        def test_controller(pve_sim_cell):
            def controller(sim):
                sim.wait_frame(0x720)
                sim.send(0x000, "0100")
                sim.send(0x220, "0F00 0010", every_ms=50)
            assert pve_sim_cell.run(controller).passed
    """)
    result = pytester.runpytest_subprocess("--strict-markers", "-v", "-k", "count")
    result.assert_outcomes(passed=2, failed=2, deselected=2)
    result.stdout.fnmatch_lines(["*test_controller[[]lose 220, count 1@500ms] PASSED*"])
    result.stdout.fnmatch_lines(["*test_controller[[]lose 220, count 20@520ms] FAILED*"])


def test_several_plans_of_one_test_run_all(plan: Path, pytester: pytest.Pytester) -> None:
    other = plan.with_name("other.toml")
    other.write_text(PLAN.replace("supply_mv = 8000", "supply_mv = 24500").replace("to_ms = 520", "to_ms = 500"))
    pytester.makepyfile(f"""
        import pytest

        @pytest.mark.pve_sim_campaign({str(plan)!r})
        class TestBoth:
            @pytest.mark.pve_sim_campaign({str(other)!r})
            def test_it(self, pve_sim_cell):
                pass
    """)
    result = pytester.runpytest_subprocess("--strict-markers", "-v")
    result.assert_outcomes(passed=9)
    result.stdout.fnmatch_lines(["*test_it[[]valve: supply_mv = 8000@500ms] PASSED*"])
    result.stdout.fnmatch_lines(["*test_it[[]valve: supply_mv = 24500@500ms] PASSED*"])


def test_devices_beside_a_plan_are_refused(plan: Path, pytester: pytest.Pytester) -> None:
    pytester.makepyfile(f"""
        import pytest

        pytestmark = pytest.mark.pve_sim("pvea-canopen@0x21", speed="step")

        @pytest.mark.pve_sim_campaign({str(plan)!r})
        def test_devices_of_the_module(pve_sim_cell):
            pass

        @pytest.mark.pve_sim("hat3000")
        @pytest.mark.pve_sim_campaign({str(plan)!r})
        def test_both(pve_sim_cell, pve_sim):
            pass
    """)
    pytester.runpytest_subprocess("--strict-markers").assert_outcomes(passed=12)
    pytester.makepyfile(f"""
        import pytest

        @pytest.mark.pve_sim("hat3000")
        @pytest.mark.pve_sim_campaign({str(plan)!r})
        def test_ignored(pve_sim_cell):
            pass
    """)
    result = pytester.runpytest_subprocess("--strict-markers")
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["*marker pve_sim has no effect: the devices of pve_sim_cell are those of the plan*"])
