"""python-can clients of the bus: their order with the calls in stepped time, and their end."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator

import can
import pytest
from conftest import is_gone

from pve_sim import Frame, Simulator, SimulatorEnded, SimulatorError, _client


def message(id: int, data: str = "") -> can.Message:
    return can.Message(arbitration_id=id, data=bytes.fromhex(data), is_extended_id=id > 0x7FF)


@pytest.fixture
def stepped() -> Iterator[Simulator]:
    """A valve on CANopen that has booted, and stands still."""
    with Simulator("pvea-canopen@0x20,name=boom", speed="step") as sim:
        sim.wait_frame(0x720)
        sim.advance(5)
        yield sim


def test_a_call_comes_after_the_frames_before_it(stepped: Simulator) -> None:
    bus, other = stepped.bus(), stepped.bus()
    for id in range(0x100, 0x140):
        bus.send(message(id, "01"))
        other.send(message(id + 0x40, "01"))
        stepped.advance(2)
        seen = [frame.id for frame in stepped.trace(2) if isinstance(frame, Frame)]
        assert seen == [id, id + 0x40]


def test_a_call_returns_after_its_frames_have_arrived(stepped: Simulator) -> None:
    bus = stepped.bus()
    for id in range(0x100, 0x140):
        stepped.send(id, "01")
        received = bus.recv(0)
        assert received is not None and (received.arbitration_id, bytes(received.data)) == (id, b"\1")
    # The answer to a request, with the request and the wait for the answer on two sides.
    bus.send(message(0x620, "40 18 10 01 00 00 00 00"))
    stepped.wait_frame(0x5A0)
    answers = [frame.arbitration_id for frame in iter(lambda: bus.recv(0), None)]
    assert answers[-1] == 0x5A0
    bus.send(message(0x000, "01 20"))
    stepped.valve.wait(nmt="operational", within_ms=1)


def test_every_frame_of_a_long_call_arrives(stepped: Simulator) -> None:
    bus = stepped.bus()
    stepped.send(0x123, every_ms=1)
    for _ in range(20):
        stepped.advance(1000)
    received = iter(lambda: bus.recv(0), None)
    assert sum(frame.arbitration_id == 0x123 for frame in received) == 20_001


def test_more_frames_than_the_gateway_accepts_do_not_stop_time(
    stepped: Simulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_client, "_ORDER_S", 0.1)
    bus = stepped.bus()
    for _ in range(2000):
        bus.send(message(0x123))
    while stepped.bus_state().load or stepped.now_us() < 1_000_000:
        stepped.advance(500)
    bus.send(message(0x124))
    stepped.advance(1)
    assert len([frame for frame in stepped.trace(4096) if isinstance(frame, Frame) and frame.id == 0x123]) == 2000
    (latest,) = stepped.trace(1)
    assert isinstance(latest, Frame) and latest.id == 0x124


def test_filters_empty_and_long_frames(stepped: Simulator) -> None:
    bus = stepped.bus(can_filters=[{"can_id": 0x124, "can_mask": 0x7FF, "extended": False}])
    for id in (0x123, 0x124, 0x18FF0124):
        stepped.send(id)
    received = bus.recv(0)
    assert received is not None and received.data == b"" and received.arbitration_id == 0x124
    assert bus.recv(0) is None
    bus.set_filters(None)
    stepped.send(0x18FF0124, bytes(range(8)))
    received = bus.recv(0)
    assert received is not None and received.is_extended_id and bytes(received.data) == bytes(range(8))
    # It came before the filters changed.
    assert bus.recv(0) is None
    bus.send(can.Message(arbitration_id=0x123, is_fd=True, data=bytes(12), is_extended_id=False))
    with pytest.raises(can.CanOperationError, match="pve-sim refused a frame: bad length; accepted: 0 to 8"):
        bus.recv(20)


def test_error_frames_arrive() -> None:
    with Simulator(speed="step", options=["--error-frames"]) as sim:
        bus = sim.bus()
        sim.disturb(1, 0x123)
        sim.send(0x123)
        assert any(frame.is_error_frame for frame in iter(lambda: bus.recv(0), None))


@pytest.mark.skipif(sys.platform != "linux", reason="looks for the end of a process")
def test_a_client_of_a_simulator_that_was_killed_says_so() -> None:
    with pytest.raises(SimulatorEnded, match="signal 9"), Simulator() as sim:
        bus, other = sim.bus(), sim.bus()
        killer = threading.Timer(0.1, os.kill, (sim.pid, signal.SIGKILL))
        killer.start()
        with pytest.raises(SimulatorEnded, match="signal 9"):
            while True:
                bus.recv()
        assert is_gone(sim.pid)
        # The system may accept a message of a connection that the other side has just closed.
        with pytest.raises(SimulatorEnded, match="signal 9"):
            while True:
                other.send(message(0x123))


def test_a_client_that_was_shut_down_says_so(stepped: Simulator) -> None:
    bus, other = stepped.bus(), stepped.bus()
    bus.shutdown()
    bus.shutdown()
    stepped.send(0x123)
    with pytest.raises(SimulatorError, match="shut down"):
        bus.recv(0)
    with pytest.raises(SimulatorError, match="shut down"):
        bus.send(message(0x123))
    assert other.recv(0) is not None


def test_a_reader_ends_with_the_simulator() -> None:
    with Simulator(speed="step") as sim:
        bus = sim.bus()
        ended: list[Exception] = []

        def read() -> None:
            try:
                while True:
                    bus.recv()
            except SimulatorError as error:
                ended.append(error)

        reader = threading.Thread(target=read)
        reader.start()
    reader.join(120)
    assert "shut down" in str(ended)


@pytest.mark.skipif(not hasattr(can.Notifier, "find_instances"), reason="python-can before 4.5 does not know them")
def test_a_notifier_ends_with_the_simulator(monkeypatch: pytest.MonkeyPatch) -> None:
    raised: list[object] = []
    monkeypatch.setattr(threading, "excepthook", raised.append)
    with Simulator(speed="step") as sim:
        received = can.BufferedReader()
        notifier = can.Notifier(sim.bus(), [received], timeout=1000)
        sim.send(0x123)
        while (frame := received.get_message(120)) is not None and frame.arbitration_id != 0x123:
            pass
        assert frame is not None
    assert notifier.stopped
    assert raised == []


def test_a_periodic_frame_is_sent() -> None:
    with Simulator() as sim:
        sim.bus().send_periodic(message(0x123), 0.01)
        for _ in range(3):
            sim.wait_frame(0x123, within_ms=60_000)
