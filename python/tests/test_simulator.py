"""The simulator through the module: devices, plant, power, frames, bus and time."""

from __future__ import annotations

import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import pytest

from pve_sim import (
    BusError,
    Conflict,
    Fault,
    Frame,
    InvalidValue,
    Led,
    Refused,
    Sensor,
    Simulator,
    SimulatorError,
    UnknownDevice,
    Valve,
    ValveState,
    WaitTimeout,
    _simulator,
)

BOOT_UP, RPDO, TPDO, EMCY = 0x720, 0x220, 0x1A0, 0x0A0
HALF = struct.pack("<Hh", 0x000F, 8192)


@pytest.fixture
def stepped() -> Iterator[Simulator]:
    """A valve on CANopen that has booted, and stands still."""
    with Simulator("pvea-canopen@0x20,name=boom", speed="step") as sim:
        sim.wait_frame(BOOT_UP)
        yield sim


def drive(sim: Simulator) -> ValveState:
    """Drives the valve to half its stroke."""
    sim.send(0, [1, 0x20])
    sim.send(RPDO, HALF, every_ms=100)
    return sim.valve.wait(position=8192, solenoids=True)


def test_python_can_drives_a_valve() -> None:
    with Simulator("pvea-canopen@0x20") as sim:
        bus = sim.bus()
        bus.send(can.Message(arbitration_id=0, data=[1, 0x20], is_extended_id=False))
        sim.valve.wait(nmt="operational")
        bus.send_periodic(can.Message(arbitration_id=RPDO, data=HALF, is_extended_id=False), 0.1)
        state = sim.valve.wait(position={"min": 8000, "max": 8192}, led={"color": "green"})
        assert (state.dsm, state.solenoids, state.active_faults) == ("active", True, ())
        answers = iter(lambda: bus.recv(20), None)
        assert next(answer for answer in answers if answer.arbitration_id == TPDO and answer.data[0] == 0x0F)


def test_a_client_without_python_can_says_what_to_install(stepped: Simulator, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "can", None)
    monkeypatch.delitem(sys.modules, "pve_sim._client", raising=False)
    with pytest.raises(SimulatorError, match="needs python-can: pip install python-can"):
        stepped.bus()


def test_a_spool_has_measured_times() -> None:
    with Simulator("pvea-canopen@0x20,stroke-ms=500", speed="step") as sim:
        sim.wait_frame(BOOT_UP)
        sim.send(0, [1, 0x20])
        sim.send(RPDO, struct.pack("<Hh", 0x000F, 16384), every_ms=100)
        since = sim.valve.wait(position={"min": 1}).t_us
        assert abs(sim.valve.wait(position=16384).t_us - since - 500_000) < 100


def test_a_state_is_typed(stepped: Simulator) -> None:
    state = stepped.valve.state()
    assert (state.name, state.kind, state.node_id, state.bit_rate) == ("boom", "pvea-canopen", 0x20, 250_000)
    assert (state.powered, state.nmt, state.dsm, state.command) == (True, "pre-operational", "init", None)
    assert (state.position, state.set_point, state.led) == (0, 0, Led("yellow", False))
    assert Fault("supply-low", False, 0) in state.faults
    assert (state.plant.supply_mv, state.plant.spool, state.plant.memory) == (24000, None, "ok")
    assert state.t_us == stepped.now_us()


def test_a_fault_comes_at_its_instant(stepped: Simulator) -> None:
    drive(stepped)
    since = stepped.valve.plant(supply_mv=8000).t_us
    state = stepped.valve.wait(faults=["supply-low"], led={"color": "red"})
    assert (state.dsm, state.t_us - since) == ("fault-hold", 2_000_000)
    assert stepped.wait_frame(EMCY, within_ms=10).data[:2] == bytes.fromhex("1234")


def test_every_part_of_the_plant_is_changed_and_put_right(stepped: Simulator) -> None:
    broken = stepped.valve.plant(
        supply_mv=30000, temperature_c=-5, spool="stuck", lever=-99, internal_fault=True, memory="damaged", bus_off=True
    ).plant
    assert (broken.supply_mv, broken.temperature_c, broken.spool, broken.lever) == (30000, -5, "stuck", -99)
    assert (broken.internal_fault, broken.memory, broken.bus_off) == (True, "damaged", True)
    weak = stepped.valve.plant(brown_out_mv=7000, oil=True, boot_ms=300, answer_ms=[5, 20], cycle_ms=10).plant
    assert (weak.brown_out_mv, weak.oil, weak.boot_ms, weak.answer_ms, weak.cycle_ms) == (7000, True, 300, [5, 20], 10)
    assert stepped.valve.plant(brown_out_mv=None, answer_ms=0).plant.brown_out_mv is None
    right = stepped.valve.plant(spool=None, lever=None, memory="ok").plant
    assert (right.spool, right.lever, right.memory, right.supply_mv) == (None, None, "ok", 30000)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"suply_mv": 8000}, "unknown key 'suply_mv'"),
        ({"supply_mv": 100_001}, "supply_mv 100001 is not valid; accepted: a whole number from 0 to 100000"),
        ({"spool": "rusty"}, "rusty"),
        ({"supply_mv": 8000, "lever": 16385}, "lever 16385 is not valid; accepted: "),
        ({"angle_cdeg": 1}, "angle_cdeg"),
    ],
)
def test_a_plant_that_cannot_be_is_refused_and_nothing_changes(
    stepped: Simulator, change: dict[str, Any], text: str
) -> None:
    before = stepped.valve.state()
    with pytest.raises(InvalidValue, match=text) as refused:
        stepped.valve.plant(**change)
    assert isinstance(refused.value, ValueError)
    assert stepped.valve.state() == before


def test_power_is_cut_and_given_and_the_processor_is_reset(stepped: Simulator) -> None:
    off = stepped.valve.power_off()
    assert (off.powered, off.node_id, off.nmt, off.led.color) == (False, None, None, "off")
    with pytest.raises(Conflict):
        stepped.valve.reset()
    assert stepped.valve.power_on().powered
    stepped.wait_frame(BOOT_UP)
    stepped.valve.reset()
    stepped.wait_frame(BOOT_UP)
    # A reset by the watchdog is an internal fault.
    stepped.valve.wait(dsm="fault-hold", led={"color": "red"})


def test_a_wait_in_vain_tells_what_was(stepped: Simulator) -> None:
    since = drive(stepped).t_us
    with pytest.raises(WaitTimeout) as timeout:
        stepped.valve.wait(dsm="fault-hold", faults=["supply-low"], within_ms=300)
    error = timeout.value
    assert isinstance(error, TimeoutError) and isinstance(error, SimulatorError)
    assert error.t_us - since == 300_000
    assert isinstance(error.state, ValveState) and error.state.position == 8192
    assert "boom did not reach this state within 300 ms" in str(error)
    assert "dsm: 'active', waited for 'fault-hold'" in str(error)
    assert "faults: [], waited for ['supply-low']" in str(error)


def test_a_wait_for_what_cannot_be_is_refused(stepped: Simulator) -> None:
    with pytest.raises(InvalidValue, match="unknown value 'suply-low'; did you mean 'supply-low'"):
        stepped.valve.wait(faults=["suply-low"])
    with pytest.raises(InvalidValue, match="unknown key 'colour'"):
        stepped.valve.wait(colour="red")  # type: ignore[call-arg]


def test_a_wait_and_a_change_need_something(stepped: Simulator) -> None:
    with pytest.raises(InvalidValue, match="wait needs a condition, such as powered=True"):
        stepped.valve.wait(within_ms=10)
    with pytest.raises(InvalidValue, match="plant needs a change, such as memory='ok'"):
        stepped.valve.plant()
    with Simulator("hat1000", speed="step") as sim:
        with pytest.raises(InvalidValue, match="wait needs a condition"):
            sim.sensor.wait()
        with pytest.raises(InvalidValue, match="plant needs a change"):
            sim.sensor.plant()
    stepped.valve.plant(spool="stuck")
    nothing: list[Any] = ["", {}]
    for spool in nothing:
        with pytest.raises(InvalidValue, match=r"^spool: "):
            stepped.valve.plant(spool=spool)
    assert stepped.valve.state().plant.spool == "stuck"


def test_faults_may_be_any_collection(stepped: Simulator) -> None:
    stepped.valve.plant(supply_mv=8000)
    for faults in ({"supply-low"}, ("supply-low",), {"supply-low": 1}.keys()):
        assert stepped.valve.wait(faults=faults).active_faults == ("supply-low",)
    with pytest.raises(InvalidValue, match="faults"):
        stepped.valve.wait(faults="supply-low", within_ms=5)


def test_a_number_is_no_data(stepped: Simulator) -> None:
    for data in (3, True):
        with pytest.raises(InvalidValue, match="data is a number; accepted: bytes, such as"):
            stepped.send(0x124, data)  # type: ignore[arg-type]
        with pytest.raises(InvalidValue, match="data is a number"):
            stepped.wait_frame(0x124, data, within_ms=5)  # type: ignore[arg-type]
        with pytest.raises(InvalidValue, match="data is a number"):
            stepped.bus.insert(0x124, data)  # type: ignore[arg-type]
    with pytest.raises(InvalidValue):
        stepped.send(0x124, [256])


def test_a_frame_in_vain_tells_which(stepped: Simulator) -> None:
    with pytest.raises(WaitTimeout, match=r"frame 0A0: 12 34 \.\. was not received.* within 50 ms") as timeout:
        stepped.wait_frame(EMCY, "12 34 ..", within_ms=50)
    assert timeout.value.state is None


def test_frames_are_sent_cyclic_ended_and_traced(stepped: Simulator) -> None:
    first = stepped.send(0x123, "0A 0b")
    stepped.send(0x123, "0A 0b", every_ms=10)
    stepped.advance(25)
    assert stepped.stop(0x123) == 1
    stepped.send(0x18FF0001, bytes([1]))
    assert stepped.stop() == 0
    ours = [frame for frame in stepped.trace(10) if isinstance(frame, Frame) and frame.sender == "http"]
    assert [frame.id for frame in ours] == [0x123] * 4 + [0x18FF0001]
    assert ours[0].t_us == first and ours[3].t_us - ours[2].t_us == 10_000
    assert ours[0].data == b"\x0a\x0b" and ours[4].extended
    assert len(stepped.trace(2)) == 2


def test_the_trace_for_people_counts_what_comes_again(stepped: Simulator) -> None:
    drive(stepped)
    stepped.advance(1000)
    text = stepped.trace_text()
    assert "NMT start, boom" in text
    assert text.count("220: 0F 00 00 20") == 1 and "times more, until" in text


def test_a_frame_that_cannot_be_is_refused(stepped: Simulator) -> None:
    with pytest.raises(InvalidValue, match="id 2048 is not valid; accepted: 0 to 2047"):
        stepped.send(0x800, extended=False)
    with pytest.raises(InvalidValue, match='data "0F0": an incomplete byte; accepted: up to 8 bytes in hex'):
        stepped.send(1, "0F0")
    with pytest.raises(InvalidValue, match="more than 8 bytes; accepted: up to 8 bytes"):
        stepped.send(1, bytes(9))
    with pytest.raises(InvalidValue, match="every_ms 0"):
        stepped.send(1, every_ms=0)


def test_a_frame_that_does_not_get_onto_the_bus_is_withdrawn(stepped: Simulator) -> None:
    stepped.disturb(1_000_000, 0x123)
    with pytest.raises(Conflict):
        stepped.send(0x123)


def test_attempts_are_destroyed(stepped: Simulator) -> None:
    assert stepped.disturb(3, 0x123).disturb.frames == 3
    stepped.send(0x123)
    assert stepped.bus_state().disturb.frames == 0
    assert (stepped.disturb(5).disturb.id, stepped.disturb(0).disturb.frames) == (None, 0)


def test_the_bit_rate_changes(stepped: Simulator) -> None:
    assert stepped.set_bit_rate(500_000).bit_rate == 500_000
    with pytest.raises(InvalidValue, match="accepted: 1000000"):
        stepped.set_bit_rate(1)
    # The valve did not follow.
    stepped.set_bit_rate(250_000)


def test_time_passes_when_told(stepped: Simulator) -> None:
    now = stepped.now_us()
    assert stepped.advance(100) == now + 100_000 == stepped.now_us()
    with Simulator() as running, pytest.raises(Conflict):
        running.advance(100)


def test_two_runs_with_the_same_calls_are_the_same() -> None:
    def run() -> list[Frame | BusError]:
        with Simulator(speed="step", seed=7) as sim:
            sim.wait_frame(BOOT_UP)
            drive(sim)
            return sim.trace()

    assert run() == run()


def test_events_tell_states_and_frames(stepped: Simulator) -> None:
    with stepped.events() as events:
        first = next(events)
        assert first.kind == "device" and first.value == stepped.valve.state()
        stepped.send(0x123, "01")
        frames = (event.value for event in events if isinstance(event.value, Frame))
        assert next(frame for frame in frames if frame.id == 0x123).data == b"\x01"
    assert list(events) == []


def test_too_many_followers_are_refused(stepped: Simulator) -> None:
    followers = [stepped.events() for _ in range(64)]
    with pytest.raises(Refused, match="too many"):
        stepped.events()
    for follower in followers:
        follower.close()


def test_events_end_with_the_simulator() -> None:
    sim = Simulator(speed="step")
    events = sim.events()
    assert next(events).kind == "device"
    sim.close()
    assert all(event.kind == "frame" for event in events)
    with pytest.raises(StopIteration):
        next(events)


def test_an_event_that_cannot_be_read_is_an_error(stepped: Simulator, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_simulator, "state_of", lambda _: int("none"))
    with stepped.events() as events, pytest.raises(ValueError, match="none"):
        next(events)


def test_devices_have_names_and_a_sensor_follows_a_valve() -> None:
    devices = ["pvea-canopen@0x20,name=boom", "pveo-canopen@0x21", "hat1000,bit-rate=250k"]
    with Simulator(*devices, links=["boom=hat1000"], speed="step") as sim:
        assert list(sim.devices) == ["boom", "pveo-canopen", "hat1000"]
        assert sim.valve is sim["boom"] is sim.valves["boom"]
        assert isinstance(sim["hat1000"], Sensor) and sim.sensor.kind == "hat1000"
        assert isinstance(sim["pveo-canopen"], Valve)
        sim.wait_frame(0x701)
        drive(sim)
        assert sim.sensor.wait(position={"min": 1}).plant.angle_cdeg > 0
        with pytest.raises(UnknownDevice, match=r"^no device 'arm'; accepted: boom, pveo-canopen, hat1000$"):
            sim["arm"]
        with pytest.raises(KeyError):
            sim.valves["hat1000"]
        with pytest.raises(InvalidValue):
            sim.sensor.plant(speed_rpm=5)


def test_a_sensor_turns() -> None:
    with Simulator("hat3000", speed="step") as sim:
        sim.wait_frame(0x701)
        assert sim.sensor.plant(angle_cdeg=9000, speed_rpm=60).plant.speed_rpm == 60
        sim.advance(250)
        assert sim.sensor.plant(speed_rpm=0).plant.angle_cdeg == 18000
        assert sim.sensor.plant(measuring_error=True).plant.measuring_error
        with pytest.raises(UnknownDevice, match="no valve, only: hat3000"):
            sim.valve  # noqa: B018


def test_a_valve_on_isobus_extends() -> None:
    with Simulator("pvea-isobus@0x83", speed="step") as sim:
        sim.wait_frame(0x18EEFF83)
        sim.advance(300)
        sim.send(0x0CFE3327, "7DFF31FFFFFFFFFF", every_ms=100)
        state = sim.valve.wait(command="extend", position=8192)
        assert (state.node_id, state.nmt, state.dsm) == (0x83, None, None)


def test_memory_is_stored_at_the_end(tmp_path: Path) -> None:
    for _ in range(2):
        with Simulator(
            speed="step", state=tmp_path / "memory", log=tmp_path / "log", options=["--log-overwrite"]
        ) as sim:
            sim.wait_frame(BOOT_UP)
    assert (tmp_path / "memory" / "pvea-canopen.nvm").exists()
    assert "720#00" in (tmp_path / "log").read_text()


def test_simulators_run_beside_each_other() -> None:
    with Simulator(speed="step") as one, Simulator(speed="step") as other:
        assert {one.bus_url, one.http_url}.isdisjoint({other.bus_url, other.http_url})
        one.valve.plant(supply_mv=8000)
        assert other.valve.state().plant.supply_mv == 24000


def test_a_pattern_means_what_it_means_in_a_scenario(stepped: Simulator) -> None:
    def answered(data: bytes | str | None) -> bool:
        stepped.send(0x620, "40 18 10 01 00 00 00 00", every_ms=100)
        try:
            frame = stepped.wait_frame("5A0", data, within_ms=150)
        except WaitTimeout:
            return False
        return frame.data.startswith(bytes.fromhex("43 18 10 01"))

    assert answered(None)
    assert answered("4318 1001 ..")
    assert answered("43 18 10 01 ?? ?? ?? ??")
    assert not answered("43181001")
    assert not answered(bytes.fromhex("43181001"))
    with pytest.raises(WaitTimeout, match="differs only in its length: 8 bytes instead of 4 bytes"):
        stepped.wait_frame(0x5A0, "43181001", within_ms=150)


def test_an_identifier_as_a_text_is_hexadecimal(stepped: Simulator) -> None:
    for id, extended in (("220", False), ("0x220", False), (0x220, False), ("00000220", True), ("0CFE3027", True)):
        stepped.send(id, "0F000020", every_ms=100)
        latest = stepped.trace()[-1]
        assert isinstance(latest, Frame) and latest.extended == extended
        assert stepped.disturb(0, id).disturb.frames == 0
        assert stepped.stop(id) == 1
    stepped.send(0x220, "", extended=True, every_ms=100)
    assert (stepped.stop(0x220), stepped.stop("220", extended=True)) == (0, 1)
    with pytest.raises(InvalidValue, match='id "22G" is not valid; accepted: 0 to 2047, or a hex string'):
        stepped.send("22G")


def test_a_spool_is_changed_by_a_word_or_an_object(stepped: Simulator) -> None:
    assert stepped.valve.plant(spool="stuck").plant.spool == "stuck"
    assert stepped.valve.plant(spool="ok").plant.spool is None
    assert stepped.valve.plant(spool={"fault": "slow"}).plant.spool == "slow"
    assert stepped.valve.plant(spool={"fault": None}).plant.spool is None
