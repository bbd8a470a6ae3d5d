"""`python -m pve_sim`: the command, even if the scripts folder is not in PATH."""

import os
import subprocess
import sys

from ._binary import find_binary
from ._errors import StartError

try:
    command = [find_binary(), *sys.argv[1:]]
    if sys.platform != "win32":
        # Signals and the exit status are those of pve-sim.
        os.execvp(command[0], command)
    with subprocess.Popen(command) as running:
        while running.poll() is None:
            try:
                running.wait()
            except KeyboardInterrupt:
                # pve-sim has received Ctrl-C, too, and ends with a status of its own.
                continue
    sys.exit(running.returncode)
except (StartError, OSError) as error:
    sys.exit(str(error))
