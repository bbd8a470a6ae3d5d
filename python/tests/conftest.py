"""What the tests share."""

from __future__ import annotations

import os
import select

pytest_plugins = ["pytester"]

#: Longest wait for anything, in seconds: a busy machine is not a fault.
PATIENCE = 120


def is_gone(pid: int) -> bool:
    """Waits for the end of a process that may be nobody's child; whether it came."""
    try:
        process = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    try:
        ended, _, _ = select.select([process], [], [], PATIENCE)
        return bool(ended)
    finally:
        os.close(process)
