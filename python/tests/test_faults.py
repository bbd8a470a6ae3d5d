"""Communication faults: their parameters, their effect, and their end."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import pytest

from pve_sim import (
    Bus,
    CommunicationFault,
    Conflict,
    FaultWithoutEffect,
    Frame,
    InvalidValue,
    Simulator,
    SimulatorEnded,
    SimulatorError,
    WaitTimeout,
)


@pytest.fixture
def sim() -> Iterator[Simulator]:
    """A valve and a sensor on CANopen that have booted, and stand still."""
    with Simulator("pvea-canopen@0x20,name=boom", "hat1000,bit-rate=250k,name=angle", speed="step") as sim:
        sim.wait_frame(0x720)
        sim.advance(50)
        yield sim


def frames(sim: Simulator, id: int) -> list[tuple[int, str]]:
    """Returns when each frame with an identifier came, in milliseconds after the first one, and its data."""
    seen = [frame for frame in sim.trace(1000) if isinstance(frame, Frame) and frame.id == id]
    return [(round((frame.t_us - seen[0].t_us) / 1000), frame.data.hex()) for frame in seen]


@pytest.mark.parametrize(
    ("add", "name", "text"),
    [
        (lambda bus: bus.lose(0x220, count=3), "lose-220", "lose 220, count 3"),
        (lambda bus: bus.lose("0x220", receivers="boom"), "lose-220", "lose 220 for boom"),
        (lambda bus: bus.lose(0x18FF0001), "lose-18FF0001", "lose 18FF0001"),
        (lambda bus: bus.lose(extended=True, id=0x1), "lose-00000001", "lose 00000001"),
        (lambda bus: bus.lose(0x700, mask=0x780, sender="boom"), "lose-700", "lose 700 mask 780 of boom"),
        (lambda bus: bus.lose("all", probability=0.5, seed=7), "lose", "lose all, probability 0.5"),
        (lambda bus: bus.lose(name="gap", from_ms=5, for_ms=20), "gap", "lose all, from 5 ms, for 20 ms"),
        (lambda bus: bus.delay(0x1A0, ms=20), "delay-1A0", "delay 1A0 by 20 ms"),
        (lambda bus: bus.delay(0x1A0, ms=(5, 20)), "delay-1A0", "delay 1A0 by 5 ms to 20 ms"),
        (
            lambda bus: bus.delay(0x1A0, burst_ms=100, overtake=True),
            "delay-1A0",
            "delay 1A0 into bursts every 100 ms, overtaken by later ones",
        ),
        (lambda bus: bus.repeat(0x1A0, times=2, after_ms=5), "repeat-1A0", "repeat 1A0 2 times every 5 ms"),
        (lambda bus: bus.swap(0x1A0, within_ms=50), "swap-1A0", "swap 1A0 within 50 ms"),
        (
            lambda bus: bus.corrupt(
                0x1A0, data={"toggle": "00 80"}, dlc={"set": 8, "clear": 1}, identifier={"set": 0x10}
            ),
            "corrupt-1A0",
            "corrupt 1A0, identifier set 10, dlc set 8, dlc clear 1, data toggle 0080",
        ),
        (lambda bus: bus.corrupt(data={"set": b"\1"}), "corrupt", "corrupt all, data set 01"),
        (lambda bus: bus.insert(0x1, "0F 00", every_ms=20), "insert-001", "insert 001: 0F 00 every 20 ms"),
        (lambda bus: bus.insert("0CFE3027", [1]), "insert-0CFE3027", "insert 0CFE3027: 01"),
        (lambda bus: bus.masquerade(0x1A0, b"\x0f"), "insert-1A0", "insert 1A0: 0F"),
        (lambda bus: bus.destroy(0x1A0, count=32), "destroy-1A0", "destroy 1A0, count 32"),
        (
            lambda bus: bus.omit(0x1A0, receivers=["angle", "the gateway"]),
            "omit-1A0",
            "omit 1A0 for angle, the gateway",
        ),
    ],
)
def test_every_parameter_arrives(
    sim: Simulator, add: Callable[[Bus], CommunicationFault], name: str, text: str
) -> None:
    fault = add(sim.bus)
    assert (fault.name, fault.fault, fault.struck, fault.is_over) == (name, text, 0, False)
    assert fault.end() == 0


def test_lost_set_points_shut_the_valve_down(sim: Simulator) -> None:
    sim.send(0, [1, 0x20])
    sim.send(0x220, "0F 00 00 20", every_ms=100)
    sim.valve.wait(position=8192)
    with sim.bus.lose(0x220, count=1) as lost:
        sim.advance(500)
        assert (lost.struck, lost.is_over) == (1, True)
        assert sim.valve.state().active_faults == ()
    with sim.bus.lose(0x220) as lost:
        sim.valve.wait(faults=["time-guarding"], within_ms=400)
    assert (lost.struck, lost.is_over) == (2, True)
    sim.advance(500)
    assert lost.struck == 2 and sim.faults() == []


@pytest.mark.parametrize(
    ("add", "expected"),
    [
        (lambda bus: bus.repeat(0x123, times=2, after_ms=5), [(0, "01"), (5, "01"), (10, "01")]),
        (lambda bus: bus.corrupt(0x123, data={"toggle": "80"}, dlc={"set": 2}), [(0, "810000")]),
        (lambda bus: bus.insert("123", "02", from_ms=5), [(0, "01"), (5, "02")]),
        (
            lambda bus: bus.masquerade(0x123, "02", every_ms=10, count=2, from_ms=5),
            [(0, "01"), (5, "02"), (15, "02")],
        ),
        (lambda bus: bus.delay(0x123, ms=20), [(0, "01")]),
        (lambda bus: bus.destroy(0x123, count=3), [(0, "01")]),
        (lambda bus: bus.omit(0x123, receivers="boom", count=1), [(0, "01")]),
    ],
)
def test_every_kind_affects_frames(
    sim: Simulator, add: Callable[[Bus], CommunicationFault], expected: list[tuple[int, str]]
) -> None:
    with add(sim.bus) as fault:
        since = sim.now_us()
        sim.send(0x123, "01")
        # A frame that is held back is answered at once.
        assert (sim.now_us() == since) == fault.name.startswith("delay")
        sim.advance(30)
    assert fault.struck > 0
    assert frames(sim, 0x123) == expected


def test_frames_are_swapped(sim: Simulator) -> None:
    sim.send(0, [1, 0x20])
    with sim.bus.swap(0x1A0, count=1):
        sim.send(0x220, "0F 00 00 20", every_ms=100)
        sim.advance(250)
    # DISABLED, HOLD, ACTIVE are sent in this order.
    assert [data[:2] for _, data in frames(sim, 0x1A0)] == ["0b", "09", "0f"]


def test_faults_are_listed_and_ended(sim: Simulator) -> None:
    assert sim.faults() == sim.end_faults() == []
    one, other = sim.bus.lose(0x123, count=1), sim.bus.delay(0x124, ms=5, name="late")
    sim.send(0x123)
    assert sim.faults() == [one, other]
    assert [(fault.struck, fault.is_over) for fault in sim.faults()] == [(1, True), (0, False)]
    assert one.end() == one.end() == 1
    assert sim.end_faults() == [other]
    assert (other.struck, other.is_over) == (0, True)
    assert sim.faults() == []
    assert repr(one) == "<CommunicationFault 'lose-123': lose 123, count 1>"


def test_a_fault_keeps_its_count_when_its_name_is_taken_again(sim: Simulator) -> None:
    with sim.bus.lose(0x123, count=1, name="gap") as one:
        sim.send(0x123)
        with sim.bus.lose(0x123, name="gap") as other:
            assert one.name == other.name
            sim.send(0x123)
            sim.send(0x123)
            assert (one.struck, other.struck) == (1, 2)
            assert one.end() == 1 and not other.is_over


def test_a_fault_without_effect_is_an_error(sim: Simulator) -> None:
    text = r"^fault lose-220 affected no frame \(lose 220, count 3\): none matched, or no time passed$"
    with pytest.raises(FaultWithoutEffect, match=text) as error, sim.bus.lose(0x220, count=3):
        sim.send(0x221)
    assert isinstance(error.value, SimulatorError)
    assert sim.faults() == []
    with pytest.raises(FaultWithoutEffect), sim.bus.lose(0x220) as fault:
        fault.end()
    with pytest.raises(FaultWithoutEffect), sim.bus.insert(0x123):
        pass
    with pytest.raises(FaultWithoutEffect), sim.bus.lose(0x220):
        sim.end_faults()
    # The name is taken again after its time.
    with pytest.raises(FaultWithoutEffect), sim.bus.lose(0x220, for_ms=5):
        sim.advance(10)
        sim.bus.lose(0x220)
    sim.end_faults()
    with sim.bus.lose(0x220, probability=0):
        sim.send(0x220)


def test_a_wait_in_vain_does_not_hide_a_fault_without_effect(sim: Simulator) -> None:
    with pytest.raises(FaultWithoutEffect, match="fault lose-222 affected no frame") as error, sim.bus.lose(0x222):
        sim.wait_frame(0x0A0, within_ms=5)
    assert isinstance(error.value.__cause__, WaitTimeout)
    with pytest.raises(FaultWithoutEffect), sim.bus.lose(0x222):
        sim.valve.wait(dsm="fault-hold", within_ms=5)
    # "Never", with a fault that has an effect.
    sim.send(0x123, every_ms=1)
    with pytest.raises(WaitTimeout), sim.bus.lose(0x123):
        sim.wait_frame(0x0A0, within_ms=5)
    with pytest.raises(WaitTimeout), sim.bus.lose(0x222, probability=0):
        sim.wait_frame(0x0A0, within_ms=5)
    assert sim.faults() == []


def test_a_fault_without_effect_is_told_beside_another_thread(sim: Simulator) -> None:
    ended = threading.Event()

    def poll() -> None:
        while not ended.is_set():
            sim.faults()

    pollers = [threading.Thread(target=poll) for _ in range(2)]
    for poller in pollers:
        poller.start()
    try:
        for number in range(10):
            with pytest.raises(FaultWithoutEffect), sim.bus.lose(0x220, name=f"gap-{number}"):
                pass
            with sim.bus.lose(0x123, name=f"lost-{number}") as lost:
                sim.send(0x123)
            assert lost.struck == 1
    finally:
        ended.set()
        for poller in pollers:
            poller.join()


def test_a_fault_ends_after_an_exception(sim: Simulator) -> None:
    with pytest.raises(ZeroDivisionError), sim.bus.lose(0x220):
        raise ZeroDivisionError
    assert sim.faults() == []
    # An end that fails does not hide it.
    with pytest.raises(ZeroDivisionError), sim.bus.lose(0x220):
        sim.close()
        raise ZeroDivisionError


def test_a_fault_of_a_simulator_that_has_ended(sim: Simulator) -> None:
    fault = sim.bus.lose(0x220)
    sim.close()
    for use in (lambda: fault.struck, fault.end, sim.faults, lambda: sim.bus.lose(0x220)):
        with pytest.raises(SimulatorEnded, match="closed"):
            use()


def test_a_fault_that_cannot_be_is_refused(sim: Simulator) -> None:
    with pytest.raises(InvalidValue, match=r"^no device or client 'bucket'; known: boom, angle"):
        sim.bus.lose(0x220, receivers="bucket")
    with pytest.raises(InvalidValue, match="delay needs ms or burst_ms, such as ms=20"):
        sim.bus.delay(0x220)
    with pytest.raises(InvalidValue, match="omit needs receivers"):
        sim.bus.omit(0x220, receivers=[])
    with pytest.raises(InvalidValue, match="unknown key 'cuont'; did you mean 'count'"):
        sim.bus.lose(0x220, cuont=3)  # type: ignore[call-arg]
    with pytest.raises(InvalidValue, match=r"insert: '220#0\.\.' is not a frame"):
        sim.bus.insert(0x220, "0..")
    one = sim.bus.lose(0x220, name="one")
    with pytest.raises(Conflict, match="a fault named 'one' is already active"):
        sim.bus.lose(0x221, name="one")
    assert one.end() == 0
