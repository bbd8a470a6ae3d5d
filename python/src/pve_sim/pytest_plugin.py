"""Fixtures for pytest, and the last frames of the bus in the report of a test that fails."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, suppress
from typing import Any

import pytest

from ._campaign import campaign
from ._device import Valve
from ._errors import SimulatorEnded
from ._faults import CommunicationFault
from ._simulator import Simulator, running

#: The number of frames in a report.
_SHOWN = 30

#: The communication faults that were active before a test.
_BEFORE: pytest.StashKey[list[CommunicationFault]] = pytest.StashKey()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Registers the settings."""
    parser.addini("pve_sim_devices", "devices of the fixture pve_sim, one a line, as for --device", type="linelist")
    parser.addini("pve_sim_speed", 'speed of virtual time, a factor or "step"', default="1")


def pytest_configure(config: pytest.Config) -> None:
    """Registers the marker."""
    config.addinivalue_line(
        "markers", "pve_sim(*devices, **arguments): the arguments of pve_sim.Simulator for the fixture pve_sim"
    )
    config.addinivalue_line("markers", "pve_sim_campaign(plan): each cell of a plan for the argument pve_sim_cell")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Runs a test with the marker `pve_sim_campaign` for each cell of its plan, or of all its plans."""
    markers = list(metafunc.definition.iter_markers("pve_sim_campaign"))
    if not markers:
        return
    own = any(marker.name == "pve_sim" for marker in metafunc.definition.own_markers)
    if own and "pve_sim" not in metafunc.fixturenames:
        reason = "the marker pve_sim has no effect: the devices of pve_sim_cell are those of the plan"
        pytest.fail(f"{metafunc.definition.nodeid}: {reason}", pytrace=False)
    cells = [cell for marker in markers for cell in campaign(*marker.args, **marker.kwargs)]
    metafunc.parametrize("pve_sim_cell", cells, ids=str)


@pytest.fixture
def pve_sim_factory(pytestconfig: pytest.Config) -> Iterator[Callable[..., Simulator]]:
    """Starts simulators with the arguments of `Simulator`. They end with the test."""
    with ExitStack() as started:

        def start(*devices: str, **arguments: Any) -> Simulator:
            devices = devices or tuple(pytestconfig.getini("pve_sim_devices"))
            arguments.setdefault("speed", pytestconfig.getini("pve_sim_speed"))
            return started.enter_context(Simulator(*devices, **arguments))

        yield start


@pytest.fixture
def pve_sim(pve_sim_factory: Callable[..., Simulator], request: pytest.FixtureRequest) -> Simulator:
    """A simulator with the devices of the marker `pve_sim` or the setting `pve_sim_devices`; by default one valve."""
    marker = request.node.get_closest_marker("pve_sim")
    return pve_sim_factory(*marker.args, **marker.kwargs) if marker else pve_sim_factory()


@pytest.fixture
def valve(pve_sim: Simulator) -> Valve:
    """The first valve of the fixture `pve_sim`."""
    return pve_sim.valve


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, None, None]:
    """Ends the communication faults that a test has added, because tests may share a simulator."""
    item.stash[_BEFORE] = _faults()
    yield
    for fault in _added(item):
        with suppress(SimulatorEnded):
            fault.end()
    # The faults keep their simulators.
    del item.stash[_BEFORE]


# A wrapper of the call could raise only with pluggy 1.2, and Debian 12 has 1.0.
@pytest.hookimpl(specname="pytest_runtest_call", trylast=True)
def pytest_pve_sim_check(item: pytest.Item) -> None:
    """Fails a passed test that proves nothing.

    Either a device ran at a different bit rate than the bus, or a communication fault of the test affected no frame.
    """
    __tracebackhide__ = True
    for simulator in list(running):
        # A simulator that has ended raises its own error.
        with suppress(SimulatorEnded):
            simulator.check_heard()
    for fault in _added(item):
        with suppress(SimulatorEnded):
            if (without_effect := fault._end_checked()) is not None:
                raise without_effect


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport() -> Generator[None, Any, None]:
    """Adds the last frames of every running simulator to the report of a failed test."""
    report: pytest.TestReport = (yield).get_result()
    if report.failed:
        for simulator in list(running):
            report.sections.append((f"pve-sim: the last frames of {simulator!r}", simulator.trace_text(_SHOWN)))


def _added(item: pytest.Item) -> list[CommunicationFault]:
    """Returns the communication faults that a test has added."""
    return [fault for fault in _faults() if fault not in item.stash[_BEFORE]]


def _faults() -> list[CommunicationFault]:
    """Returns the communication faults of all running simulators."""
    faults = []
    for simulator in list(running):
        with suppress(SimulatorEnded):
            faults += simulator.faults()
    return faults
