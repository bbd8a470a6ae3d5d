"""schemathesis against the description of the control interface, with all its checks: what is described is accepted and answered,
and nothing else is. The argument after the bus is the URL of the interface, of a simulator with a valve `boom` and a sensor `angle`.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

# A wait is asked for in one call and answered when it is over, or refused for the kind of its device; a profile has increasing times
# and values within the range of its word, and a fault has one kind with its own parameters: no schema says that.
CONFIG = """
hooks = "{hooks}"
seed = 1
continue-on-failure = true

[[operations]]
include-name = "POST /wait"
checks.positive_data_acceptance.expected-statuses = [200, 400, 408]

[[operations]]
include-name = "PATCH /devices/{{name}}/plant"
checks.positive_data_acceptance.expected-statuses = [200, 400, 404, 409]

[[operations]]
include-name = "POST /bus/faults"
checks.positive_data_acceptance.expected-statuses = [200, 400, 409]
"""

# The same inputs each time, a few of each call; events never end, and are looked at by other tests.
OPTIONS = ["--checks", "all", "--phases", "examples,coverage,fuzzing", "--max-examples", "10", "--exclude-operation-id", "followEvents"]

hooks = Path(__file__).with_name("openapi_hooks.py")
with tempfile.TemporaryDirectory() as folder:
    config = Path(folder, "schemathesis.toml")
    config.write_text(CONFIG.format(hooks=hooks.as_posix()))
    command = [Path(sys.executable).with_name("schemathesis"), "--config-file", config, "run"]
    url = f"{sys.argv[4]}/api/v1/openapi.json"
    run = subprocess.run([*command, url, *OPTIONS, "--no-color"], cwd=folder, env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"})
sys.exit(run.returncode)
