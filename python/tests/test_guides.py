"""The guide for CI as its reader goes through it: the tests in it pass, its YAML is in step with itself."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent
GUIDE = (ROOT / "docs/guides/ci.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    """Returns the fenced blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", GUIDE, re.DOTALL | re.MULTILINE)


def test_a_controller_meets_a_valve_that_breaks(pytester: pytest.Pytester) -> None:
    shutil.copy(ROOT / "examples/boom.py", pytester.path / "controller.py")
    # A tenth of the speed: a controller that the machine holds up for two seconds has not stopped. So its way is shorter.
    pytester.makeini("[pytest]\npve_sim_speed = 0.1\n")
    guide = blocks("python")[0].replace("timeout=60", "timeout=600")
    shorter = guide.replace("controller(pve_sim, 60)", "controller(pve_sim, 20)").replace("60 * 16384", "20 * 16384")
    pytester.makepyfile(shorter)
    pytester.runpytest_subprocess().assert_outcomes(passed=2)


def division(workflow: int) -> str:
    """Returns the commands with which a workflow chooses the scenarios of a shard."""
    found = re.search(r"(printf '%s\\n' scenarios/\S+ \| awk \"[^\"]*\") \| xargs -r pve-sim", blocks("yaml")[workflow])
    assert found
    return found[1]


# GitHub counts the jobs from 0, GitLab from 1.
@pytest.mark.parametrize(
    ("workflow", "number", "count", "first"), [(0, "SHARD", "SHARDS", 0), (1, "CI_NODE_INDEX", "CI_NODE_TOTAL", 1)]
)
def test_every_file_is_in_one_shard(
    pytester: pytest.Pytester, workflow: int, number: str, count: str, first: int
) -> None:
    names = [f"scenarios/{name}.toml" for name in "abcde"]
    (pytester.path / "scenarios").mkdir()
    for name in names:
        (pytester.path / name).touch()
    numbers = (first, first + 1)
    command = ("sh", "-c", division(workflow))
    shards = [pytester.run("env", f"{number}={shard}", f"{count}=2", *command).outlines for shard in numbers]
    assert all(shards)
    assert sorted(name for shard in shards for name in shard) == names


def test_a_job_of_github_that_chooses_no_file_by_mistake_fails(pytester: pytest.Pytester) -> None:
    workflow = blocks("yaml")[0]
    # GitHub knows both numbers, whatever the matrix is.
    assert "SHARD: ${{ strategy.job-index }}\n" in workflow
    assert "SHARDS: ${{ strategy.job-total }}\n" in workflow
    # These are the options of GitHub for `shell: bash`, and without a shell.
    options = "-eo pipefail" if "        shell: bash\n" in workflow else "-e"
    command = f"SHARD=0 SHARDS=; {division(0)} | xargs -r echo"
    assert pytester.run("bash", *options.split(), "-c", command).ret != 0
