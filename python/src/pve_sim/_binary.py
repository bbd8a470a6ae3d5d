"""The location of the binary."""

from __future__ import annotations

import os
import shutil
from importlib import metadata
from pathlib import Path

from ._errors import StartError

_NAME = "pve-sim.exe" if os.name == "nt" else "pve-sim"


def find_binary() -> str:
    """Returns the path of pve-sim: from the environment variable `PVE_SIM`, this package, or PATH."""
    given = os.environ.get("PVE_SIM")
    if given:
        if shutil.which(given) is None:
            raise StartError(f"PVE_SIM={given}: not an executable file")
        return given
    found = _installed() or shutil.which(_NAME)
    if found is None:
        raise StartError("pve-sim was not found: PVE_SIM is not set, and neither this package nor PATH has it")
    return found


def _installed() -> str | None:
    """Returns the path of the binary in the wheel, from the list of installed files."""
    try:
        files = metadata.files("pve-sim") or []
    except metadata.PackageNotFoundError:
        return None
    paths = (Path(str(file.locate())) for file in files if file.name == _NAME)
    return next((os.path.normpath(path) for path in paths if path.exists()), None)
