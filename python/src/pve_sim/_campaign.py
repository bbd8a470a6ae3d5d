"""Campaigns: each fault of a plan at each instant, against a controller in Python."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ._binary import find_binary
from ._errors import Conflict, InvalidValue, StartError
from ._simulator import Simulator

#: A controller that drives the valves of a simulator in stepped time. It may return at any time, or never.
Controller = Callable[[Simulator], object]


@dataclass(frozen=True)
class CellResult:
    """The verdict on a cell. Times are in microseconds after the fault; None if the reaction did not occur."""

    #: "no-effect", "safe", "late", "safe-undetected", "not-safe", "undetected", "hung" or "not-injected".
    verdict: str
    detected_us: int | None
    safe_us: int | None
    #: The number of frames that a communication fault affected; 1 for any other fault once it has acted.
    struck: int
    #: The exception of a controller that failed. If it failed before the verdict, the verdict is "hung".
    error: Exception | None = None
    #: The reason for the verdict "not-injected" if the proof of detection held before the fault.
    reason: str | None = None

    @property
    def passed(self) -> bool:
        """Whether no limit of the plan is broken."""
        return self.verdict in ("no-effect", "safe")

    def __bool__(self) -> bool:
        """Whether the cell passed: `assert cell.run(controller)` must not accept each verdict."""
        return self.passed


@dataclass(frozen=True)
class Cell:
    """One fault of a plan at one instant. `str` is its readable ID."""

    plan: str
    #: The number for `pve-sim campaign PLAN --cell`.
    number: int
    fault: str
    reference: str | None
    seed: int
    #: The instant of the fault, in microseconds of virtual time.
    at_us: int
    executable: str | None = None

    def __str__(self) -> str:
        return f"{self.fault}@{self.at_us / 1000:g}ms"

    def simulator(self) -> Simulator:
        """Returns the devices of the plan in stepped time. The simulator injects the fault at its instant."""
        options = ["--plan", self.plan, "--cell", str(self.number)]
        return Simulator(speed="step", options=options, executable=self.executable)

    def run(self, controller: Controller) -> CellResult:
        """Lets a controller drive the devices, and returns the verdict.

        Once the cell is decided, the controller's next call that takes time raises `Conflict`, which ends the
        controller. If the controller returns earlier, time continues without it.

        Raises:
            AssertionError: the controller's own check failed after the verdict.
        """
        with self.simulator() as sim:
            error: Exception | None = None
            try:
                controller(sim)
            except Exception as raised:  # noqa: BLE001
                error = raised
            answer = _answer(sim)
            if error is not None and not answer["decided"]:
                return CellResult("hung", None, None, 0, error)
            if isinstance(error, AssertionError):
                raise error
            if isinstance(error, Conflict):
                error = None
            while not answer["decided"]:
                sim.advance(max(1, (answer["until_us"] - sim.now_us()) // 1000))
                answer = _answer(sim)
            result = answer["result"]
            keys = ("verdict", "detected_us", "safe_us", "struck", "reason")
            return CellResult(**{key: result.get(key) for key in keys}, error=error)


def _answer(sim: Simulator) -> dict[str, Any]:
    answer: dict[str, Any] = sim._process.call("GET", "/cell")
    return answer


def campaign(plan: str | os.PathLike[str], *, executable: str | os.PathLike[str] | None = None) -> list[Cell]:
    """Returns the cells of a plan: each fault at each instant, with each seed.

    Raises:
        InvalidValue: the plan cannot be read; the message has the line and the accepted values.
    """
    command = [os.fspath(executable or find_binary()), "campaign", os.fspath(plan), "--list"]
    try:
        listed = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=False)
    except OSError as error:
        raise StartError(f"{command[0]}: {error.strerror or error}") from error
    if listed.returncode != 0:
        raise InvalidValue(listed.stderr.strip())
    given = None if executable is None else os.fspath(executable)
    keys = ("number", "fault", "reference", "seed", "at_us")
    cells = (json.loads(line) for line in listed.stdout.splitlines())
    return [Cell(plan=os.fspath(plan), executable=given, **{key: cell[key] for key in keys}) for cell in cells]


__all__ = ["Cell", "CellResult", "Controller", "campaign"]
