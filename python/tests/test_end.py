"""Start and end: every simulator that starts ends, whatever happens to whoever started it."""

from __future__ import annotations

import gc
import os
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
import threading
from collections.abc import Callable
from pathlib import Path

import can
import pytest
from conftest import PATIENCE, is_gone

from pve_sim import Simulator, SimulatorEnded, StartError, _process, campaign, find_binary

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc, or for the end of strangers")


def test_the_command_is_that_of_the_wheel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PVE_SIM", raising=False)
    found = Path(find_binary())
    assert found.parent.samefile(sysconfig.get_path("scripts")) and found.stem == "pve-sim"


def test_the_environment_names_another_command(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    other = tmp_path / "other"
    shutil.copy(find_binary(), other)
    monkeypatch.setenv("PVE_SIM", str(other))
    assert find_binary() == str(other)
    with Simulator() as sim:
        assert sim.valve.state().powered


def test_an_environment_that_names_no_command_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for missing in (tmp_path / "missing", tmp_path):
        monkeypatch.setenv("PVE_SIM", str(missing))
        for start in (find_binary, Simulator, lambda: campaign("plan.toml")):
            with pytest.raises(StartError, match=f"^PVE_SIM={re.escape(str(missing))}: not an executable file$"):
                start()


def test_the_module_runs_the_command() -> None:
    ran = subprocess.run(
        [sys.executable, "-m", "pve_sim", "eds", "pvea"], capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert ran.returncode == 2 and "pvea-canopen" in ran.stderr


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 0), (signal.SIGTERM, 0), (signal.SIGKILL, -9)])
def test_a_signal_to_the_module_is_one_to_the_command(tmp_path: Path, number: signal.Signals, status: int) -> None:
    command = [sys.executable, "-m", "pve_sim", "run", "--bus", "socketcand://127.0.0.1:0/pve0", "--no-http"]
    with subprocess.Popen(
        [*command, "--state", str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
    ) as ran:
        assert ran.stdout is not None and ran.stdout.readline().startswith(b"pve-sim ready")
        os.kill(ran.pid, number)
        assert ran.wait(PATIENCE) == status
        # Nobody is left who holds the pipe.
        ran.stdout.read()


def test_an_interrupted_command_has_its_own_status(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = tmp_path / "command"
    command.write_text("#!/bin/sh\ntrap 'exit 3' INT\necho ready\nread line\n")
    command.chmod(0o755)
    monkeypatch.setenv("PVE_SIM", str(command))
    with subprocess.Popen(
        [sys.executable, "-m", "pve_sim"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
    ) as ran:
        assert ran.stdout is not None and ran.stdout.readline() == b"ready\n"
        os.killpg(ran.pid, signal.SIGINT)
        assert ran.wait(PATIENCE) == 3


@pytest.mark.parametrize(
    ("start", "text"),
    [
        (lambda: Simulator("valve"), "exit status 2.*unknown kind 'valve'; accepted: pvea-canopen"),
        (lambda: Simulator("hat1000", "hat3000"), "both have node ID 0x01"),
        (lambda: Simulator(options=["--nonsense"]), "--nonsense"),
        (lambda: Simulator(executable="/no/such/command"), "/no/such/command: No such file"),
        (lambda: Simulator(executable=sys.executable), "did not start.*exit status"),
    ],
)
def test_what_cannot_start_says_why(start: Callable[[], Simulator], text: str) -> None:
    with pytest.raises(StartError, match=f"(?s){text}"):
        start()


def test_another_program_is_no_simulator() -> None:
    with pytest.raises(StartError, match="is not pve-sim"):
        Simulator(executable=shutil.which("echo"))


def test_a_closed_simulator_answers_no_more() -> None:
    with Simulator() as sim:
        sim.close()
        sim.close()
        with pytest.raises(SimulatorEnded, match="closed"):
            sim.valve.state()
    assert is_gone(sim.pid)


def test_a_simulator_that_was_killed_says_so() -> None:
    with pytest.raises(SimulatorEnded, match=r"ended by itself \(signal 9"), Simulator() as sim:
        os.kill(sim.pid, signal.SIGKILL)
        assert is_gone(sim.pid)
        with pytest.raises(SimulatorEnded, match="signal 9"):
            sim.valve.state()


def test_a_simulator_that_has_ended_leaves_its_trace() -> None:
    with pytest.raises(SimulatorEnded, match="exit status 0"), Simulator(speed="step") as sim:
        sim.wait_frame(0x720)
        os.kill(sim.pid, signal.SIGTERM)
        assert is_gone(sim.pid)
        assert "boot-up" in sim.trace_text()


def test_a_simulator_that_is_killed_ends_a_wait() -> None:
    sim = Simulator()
    killer = threading.Timer(0.1, os.kill, (sim.pid, signal.SIGKILL))
    killer.start()
    with pytest.raises(SimulatorEnded, match="signal 9"):
        sim.valve.wait(dsm="fault-hold", within_ms=600_000)
    # A test may have caught the first error.
    with pytest.raises(SimulatorEnded, match="signal 9"):
        sim.close()
    sim.close()


def test_an_end_that_stores_nothing_says_so(tmp_path: Path) -> None:
    memory = tmp_path / "memory"
    with (
        pytest.raises(SimulatorEnded, match=r"(?s)did not end without an error \(exit status 1\).*memory"),
        Simulator(speed="step", state=memory) as sim,
    ):
        sim.wait_frame(0x720)
        shutil.rmtree(memory)
        memory.touch()
    assert is_gone(sim.pid)
    # It hides no error of the test.
    memory.unlink()
    with pytest.raises(ZeroDivisionError), Simulator(speed="step", state=memory) as sim:
        sim.wait_frame(0x720)
        shutil.rmtree(memory)
        memory.touch()
        raise ZeroDivisionError


def test_a_simulator_that_hangs_is_killed_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_process, "_END_S", 0.1)
    sim = Simulator()
    os.kill(sim.pid, signal.SIGSTOP)
    with pytest.raises(SimulatorEnded, match=r"did not end within 0\.1 s and was killed"):
        sim._process.close()
    assert is_gone(sim.pid)


@pytest.mark.parametrize("script", ['COMMAND "$@"', 'trap : TERM; COMMAND "$@"', 'COMMAND "$@" & wait'])
def test_a_script_that_runs_the_command_ends_with_it(tmp_path: Path, script: str) -> None:
    wrapper = tmp_path / "wrapper"
    wrapper.write_text(f"#!/bin/sh\n{script.replace('COMMAND', find_binary())}\ntrue\n")
    wrapper.chmod(0o755)
    with Simulator(executable=str(wrapper), speed="step", state=tmp_path / "memory") as sim:
        (child,) = Path(f"/proc/{sim.pid}/task/{sim.pid}/children").read_text().split()
        sim.wait_frame(0x720)
    assert is_gone(int(child)) and is_gone(sim.pid)
    assert (tmp_path / "memory" / "pvea-canopen.nvm").exists()


def test_a_script_that_ends_before_the_command_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_process, "_END_S", 0.1)
    wrapper = tmp_path / "wrapper"
    wrapper.write_text(f'#!/bin/sh\n{find_binary()} "$@" &\necho $! > {tmp_path / "pid"}\nwait\n')
    wrapper.chmod(0o755)
    sim = Simulator(executable=str(wrapper))
    os.kill(sim.pid, signal.SIGKILL)
    with pytest.raises(SimulatorEnded, match="signal 9"):
        sim.close()
    assert is_gone(int((tmp_path / "pid").read_text()))


def test_events_of_a_simulator_that_was_killed_end_with_an_error() -> None:
    with pytest.raises(SimulatorEnded, match="signal 9"), Simulator(speed="step") as sim:
        events = sim.events()
        next(events)
        os.kill(sim.pid, signal.SIGKILL)
        for _ in range(2):
            with pytest.raises(SimulatorEnded, match="signal 9"):
                list(events)
        events.close()
        assert list(events) == []


def test_events_keep_their_simulator() -> None:
    events = Simulator(speed="step").events()
    gc.collect()
    assert next(events).kind == "device"
    events.close()


def test_a_simulator_that_is_closed_ends_a_wait() -> None:
    sim = Simulator()
    closer = threading.Timer(0.1, sim.close)
    closer.start()
    with pytest.raises(SimulatorEnded, match="closed"):
        sim.valve.wait(dsm="fault-hold", within_ms=600_000)
    closer.join()


def test_an_exception_tells_the_last_frames() -> None:
    with pytest.raises(RuntimeError) as error, Simulator(speed="step") as sim:
        sim.wait_frame(0x720)
        raise RuntimeError("the controller is wrong")
    assert "boot-up" in error.value.__notes__[0]
    assert is_gone(sim.pid)


def test_a_simulator_that_nobody_knows_ends() -> None:
    sim = Simulator()
    pid, valve = sim.pid, sim.valve
    assert sim.valve is valve is sim.devices["pvea-canopen"]
    del sim
    gc.collect()
    assert valve.state().powered, "a device keeps its simulator"
    gc.disable()
    try:
        del valve
        assert is_gone(pid)
    finally:
        gc.enable()


def test_a_client_keeps_its_simulator() -> None:
    bus = Simulator().bus()
    gc.collect()
    bus.send(can.Message(arbitration_id=0, data=[1, 0x20], is_extended_id=False))
    pid = bus.simulator.pid  # type: ignore[attr-defined]
    bus.shutdown()
    del bus
    gc.collect()
    assert is_gone(pid)


def test_a_long_trace_blocks_nobody() -> None:
    with Simulator(speed="step") as sim:
        sim.wait_frame(0x720)
        sim.send(0x123, bytes(8), every_ms=1)
        assert sim.advance(30_000) > 30_000_000


def test_nothing_leaks(caplog: pytest.LogCaptureFixture) -> None:
    def held() -> tuple[int, int]:
        gc.collect()
        return len(os.listdir("/proc/self/fd")), threading.active_count()

    with Simulator() as sim:
        bus = sim.bus()
    before = held()
    for _ in range(30):
        with Simulator() as sim:
            bus = sim.bus()
            sim.valve.state()
            next(sim.events())
    del bus
    assert held() == before
    assert not caplog.text, "python-can tells of a client that was not shut down"


def started(script: str) -> tuple[subprocess.Popen[str], int]:
    """Starts a script that prints the ID of its simulator's process."""
    script = f"import os, signal, sys, pve_sim\nsim = pve_sim.Simulator()\nprint(sim.pid, flush=True)\n{script}"
    parent = subprocess.Popen([sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    return parent, int(parent.stdout.readline())


@pytest.mark.parametrize(
    "script",
    [
        "",
        "sys.exit(3)",
        "raise ValueError",
        "os.kill(os.getpid(), signal.SIGINT)\nsys.stdin.read()",
        "os.kill(os.getpid(), signal.SIGTERM)\nsys.stdin.read()",
        "os.kill(os.getpid(), signal.SIGKILL)\nsys.stdin.read()",
        "os._exit(0)",
        "sim.bus()",
        "with sim: raise KeyboardInterrupt",
    ],
)
def test_a_simulator_ends_with_the_interpreter(script: str) -> None:
    parent, simulator = started(script)
    with parent:
        assert is_gone(simulator)


def test_a_fork_does_not_end_the_simulator() -> None:
    parent, simulator = started("""
if os.fork() == 0:
    sys.exit()
os.wait()
print(sim.valve.state().powered, flush=True)
sys.stdin.read()
""")
    with parent:
        assert parent.stdout is not None and parent.stdout.readline() == "True\n"
    assert is_gone(simulator)


def test_ctrl_c_leaves_the_simulator_to_python() -> None:
    script = """
try:
    os.killpg(0, signal.SIGINT)
    sys.stdin.read()
except KeyboardInterrupt:
    print(sim.valve.state().powered, flush=True)
"""
    code = f"import os, signal, sys, pve_sim\nos.setsid()\nsim = pve_sim.Simulator()\n{script}"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert ran.stdout == "True\n", ran.stderr
