"""`python -m pve_sim`: the command, even if the scripts folder is not in PATH."""

import subprocess
import sys

from ._binary import find_binary
from ._errors import StartError

try:
    sys.exit(subprocess.call([find_binary(), *sys.argv[1:]]))
except (StartError, OSError) as error:
    sys.exit(str(error))
except KeyboardInterrupt:
    # pve-sim has received Ctrl-C, too.
    sys.exit(0)
