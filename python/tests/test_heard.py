"""Devices at a different bit rate than the bus: told at the start, with a wait in vain, and at the end of a test."""

from __future__ import annotations

import pytest

from pve_sim import BusError, NotHeard, Simulator, UnknownDevice

DEAF = (
    "hat1000 runs at 500 kbit/s and the bus at 250 kbit/s: it cannot communicate and will disturb the bus; "
    "use hat1000,bit-rate=250k, or a bus at 500k"
)
DEVICES = "pvea-canopen", "hat1000,bit-rate=500k"


@pytest.mark.parametrize("speed", [1, "step"])
def test_a_bus_on_which_somebody_is_not_heard_does_not_start(speed: float) -> None:
    with pytest.raises(NotHeard) as error:
        Simulator(*DEVICES, speed=speed)
    assert str(error.value) == DEAF


def test_a_device_without_a_rate_takes_that_of_the_bus() -> None:
    with Simulator("pvea-canopen", "hat1000", speed="step") as sim:
        assert sim.wait_frame(0x701).data == b"\0"
        assert sim.sensor.state().bit_rate == sim.bus_state().bit_rate == 250_000


def test_one_that_is_not_to_be_heard_is_named() -> None:
    with Simulator(*DEVICES, speed="step", not_heard="hat1000") as sim:
        sim.advance(50)
        (unheard,) = sim.bus_state().not_heard
        assert (unheard.device, unheard.is_over, unheard.reason) == ("hat1000", False, DEAF)
        # The error frames are in the trace.
        errors = [entry for entry in sim.trace() if isinstance(entry, BusError)]
        assert "error frame" in errors[0].meaning and errors[0].sender == "hat1000"
        assert "!!  hat1000: error-passive" in sim.trace_text(1000)
    with pytest.raises(UnknownDevice, match="no device hat3000"):
        Simulator(*DEVICES, not_heard=["hat3000", "hat1000"])


def test_a_change_of_the_bus_has_a_second() -> None:
    with Simulator(speed="step") as sim:
        sim.wait_frame(0x720)
        sim.set_bit_rate(500_000)
        sim.advance(999)
        sim.set_bit_rate(250_000)
        sim.advance(5000)
        assert sim.bus_state().not_heard == ()
        sim.set_bit_rate(500_000)
        sim.advance(1001)
        sim.set_bit_rate(250_000)
        with pytest.raises(NotHeard, match="pvea-canopen runs at 250 kbit/s and the bus at 500"):
            sim.check_heard()
        (unheard,) = sim.bus_state().not_heard
        assert unheard.is_over
        # Told once.
        sim.check_heard()


def test_a_wait_in_vain_and_the_end_tell_of_it() -> None:
    with Simulator(speed="step") as sim:
        sim.wait_frame(0x720)
        sim.set_bit_rate(500_000)
        with pytest.raises(NotHeard):
            sim.wait_frame(0x1A0, within_ms=10)
    with Simulator(speed="step") as sim:
        sim.wait_frame(0x720)
        sim.set_bit_rate(500_000)
        with pytest.raises(NotHeard):
            sim.valve.wait(nmt="operational", within_ms=10)
    with Simulator(speed="step") as sim:
        sim.wait_frame(0x720)
        sim.set_bit_rate(500_000)
        sim.disturb(100_000)
        with pytest.raises(NotHeard):
            sim.send(0x000, "0100")
    sim = Simulator(speed="step")
    sim.wait_frame(0x720)
    sim.set_bit_rate(500_000)
    with pytest.raises(NotHeard):
        sim.close()
    sim.close()
    with pytest.raises(NotHeard), Simulator(speed="step") as sim:
        sim.wait_frame(0x720)
        sim.set_bit_rate(500_000)
    # An error of the test itself is not hidden.
    with pytest.raises(ZeroDivisionError), Simulator(speed="step") as sim:
        sim.set_bit_rate(500_000)
        raise ZeroDivisionError


def test_the_fixtures_fail_the_test(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("""
        import pytest
        from pve_sim import Simulator

        @pytest.mark.pve_sim("pvea-canopen", speed="step")
        def test_is_left_alone(pve_sim):
            pve_sim.wait_frame(0x720)
            pve_sim.set_bit_rate(500_000)

        @pytest.fixture
        def only_the_valve():
            sim = Simulator("pvea-canopen", speed="step")
            sim.wait_frame(0x720)
            sim.set_bit_rate(500_000)
            return sim.valve

        def test_has_a_device(only_the_valve):
            assert only_the_valve.state().powered

        @pytest.mark.pve_sim("pvea-canopen", "hat1000,bit-rate=500k", speed="step")
        def test_does_not_start(pve_sim):
            pass

        @pytest.mark.pve_sim("pvea-canopen", "hat1000,bit-rate=500k", speed="step", not_heard="hat1000")
        def test_means_it(pve_sim):
            pve_sim.wait_frame(0x720)
    """)
    result = pytester.runpytest_subprocess()
    result.assert_outcomes(failed=2, errors=1, passed=1)
    result.stdout.fnmatch_lines(["*NotHeard: pvea-canopen runs at 250 kbit/s and the bus at 500 kbit/s: *"] * 2)
    result.stdout.fnmatch_lines(["*the last frames of <Simulator pvea-canopen at *"] * 2)
