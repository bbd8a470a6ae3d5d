"""The fixtures for pytest, and what a report of a failure has."""

from __future__ import annotations

import pytest

from pve_sim import pytest_plugin

FAILING = """
    import pytest

    @pytest.mark.pve_sim("pvea-canopen@0x20,name=boom", speed="step")
    def test_shuts_down(pve_sim, valve):
        pve_sim.wait_frame(0x720)
        pve_sim.send(0, "0120")
        valve.wait(dsm="fault-hold", within_ms=10)
"""


def test_a_failure_shows_the_last_frames(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(FAILING)
    result = pytester.runpytest_subprocess()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        [
            "*WaitTimeout: boom did not reach this state within 10 ms*",
            "*dsm: 'init', waited for 'fault-hold'",
            "*pve-sim: the last frames of <Simulator boom at socketcand://*",
            "*720: 00 *boom: boot-up",
            "*000: 01 20 *NMT start, boom",
        ]
    )


def test_a_simulator_of_ones_own_fixture_is_shown_too(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("""
        import pytest, pve_sim

        @pytest.fixture(scope="module")
        def rig():
            with pve_sim.Simulator(speed="step") as sim:
                sim.wait_frame(0x720)
                yield sim

        def test_passes(rig):
            pass

        def test_fails(rig):
            assert rig.valve.state().position == 1
    """)
    result = pytester.runpytest_subprocess()
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["*the last frames of <Simulator pvea-canopen*", "*boot-up"])


def test_markers_settings_and_the_factory_choose_the_devices(pytester: pytest.Pytester) -> None:
    pytester.makeini("""
        [pytest]
        pve_sim_speed = step
        pve_sim_devices =
            hat1000
            pvea-canopen@0x21,bit-rate=500k
    """)
    pytester.makepyfile("""
        import pytest

        def test_settings(pve_sim):
            assert list(pve_sim.devices) == ["hat1000", "pvea-canopen"]
            assert pve_sim.advance(1) == 1000

        @pytest.mark.pve_sim("pveo-canopen", speed=1)
        def test_marker(pve_sim, valve):
            assert valve.kind == "pveo-canopen"
            with pytest.raises(Exception, match="step"):
                pve_sim.advance(1)

        @pytest.mark.pve_sim(seed=3)
        def test_marker_without_devices(pve_sim):
            assert len(pve_sim.devices) == 2

        def test_factory(pve_sim_factory):
            one, other = pve_sim_factory("hat3000"), pve_sim_factory()
            assert one.sensor.kind == "hat3000" and len(other.devices) == 2
    """)
    pytester.runpytest_subprocess("--strict-markers").assert_outcomes(passed=4)


def test_what_a_test_leaves_does_not_last(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("""
        import pytest, pve_sim

        @pytest.fixture(scope="module")
        def rig():
            with pve_sim.Simulator(speed="step") as sim:
                sim.bus.delay(0x1A0, ms=5)
                yield sim

        def test_leaves_a_fault(rig):
            rig.bus.lose(0x220)
            rig.send(0x220)
            assert len(rig.faults()) == 2

        @pytest.mark.xfail(raises=ZeroDivisionError, strict=True)
        def test_leaves_a_fault_and_fails(rig):
            assert [fault.name for fault in rig.faults()] == ["delay-1A0"]
            rig.bus.lose(0x220)
            raise ZeroDivisionError

        def test_has_none(rig):
            assert [fault.name for fault in rig.faults()] == ["delay-1A0"]

        def test_ends_the_one_of_the_fixture(rig):
            rig.end_faults()
            with rig.bus.lose(0x220):
                pass
    """)
    result = pytester.runpytest_subprocess()
    result.assert_outcomes(passed=2, xfailed=1, failed=1)
    result.stdout.fnmatch_lines(
        [
            ">       with rig.bus.lose(0x220):",
            "E       pve_sim._errors.FaultWithoutEffect: fault lose-220 affected no frame (lose 220): *",
        ]
    )


def test_a_fault_without_effect_fails_its_test(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("""
        import pytest, pve_sim

        @pytest.fixture(scope="module")
        def rig():
            with pve_sim.Simulator(speed="step") as sim:
                sim.bus.lose(0x222, name="lasting")
                yield sim

        def test_loses_nothing(rig):
            rig.bus.lose(0x220)

        def test_loses_nothing_later(rig):
            fault = rig.bus.lose(0x220, from_ms=50)
            rig.send(0x220)
            rig.bus.lose(0x221)

        def test_loses(rig):
            rig.bus.lose(0x220)
            rig.send(0x220)

        def test_cannot_lose(rig):
            rig.bus.lose(0x220, probability=0)

        def test_knows(rig):
            assert rig.bus.lose(0x220).end() == 0

        def test_ends_all(rig):
            rig.bus.lose(0x220)
            rig.end_faults()

        def test_fails(rig):
            rig.bus.lose(0x220)
            raise ZeroDivisionError

        def test_has_none(rig):
            assert rig.faults() == []
    """)
    result = pytester.runpytest_subprocess()
    result.assert_outcomes(passed=5, failed=3)
    result.stdout.fnmatch_lines(
        [
            "*FaultWithoutEffect: fault lose-220 affected no frame (lose 220): *",
            "*FaultWithoutEffect: fault lose-220 affected no frame (lose 220, from 50 ms): *",
            "E       ZeroDivisionError",
        ]
    )


def test_a_simulator_that_dies_is_an_error(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("""
        import os, signal

        def test_passes(pve_sim):
            os.kill(pve_sim.pid, signal.SIGKILL)
            os.waitid(os.P_PID, pve_sim.pid, os.WEXITED | os.WNOWAIT)
    """)
    result = pytester.runpytest_subprocess()
    result.assert_outcomes(passed=1, errors=1)
    result.stdout.fnmatch_lines(["*pve-sim ended by itself (signal 9)*"])


def test_what_cannot_start_is_told(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("""
        import pytest

        @pytest.mark.pve_sim("valve")
        def test_it(pve_sim):
            pass
    """)
    result = pytester.runpytest_subprocess()
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["*StartError: pve-sim did not start (exit status 2)*unknown kind 'valve'*"])


def test_tests_run_in_parallel(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("""
        import pytest

        @pytest.mark.parametrize("run", range(12))
        @pytest.mark.pve_sim(speed="step")
        def test_low_supply(pve_sim, valve, run):
            since = valve.plant(supply_mv=8000).t_us
            assert valve.wait(dsm="fault-hold").t_us - since == 2_000_000
    """)
    pytester.runpytest_subprocess("-n", "4").assert_outcomes(passed=12)


def test_the_hooks_work_with_the_pytest_of_debian_12() -> None:
    hooks = [value.pytest_impl for value in vars(pytest_plugin).values() if hasattr(value, "pytest_impl")]
    # Its pluggy 1.0 has no wrappers in this style.
    assert hooks and not any(hook.get("wrapper") for hook in hooks)
