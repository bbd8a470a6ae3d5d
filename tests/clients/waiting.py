"""Waiting without sleeping: for what comes into a queue, with a time limit."""

import queue
import time

#: Longest wait for anything, seconds of the wall clock: that a dead test ends with a sentence. No device is measured by it.
PATIENCE = 120
#: After this a script that hangs says where, and ends.
LIFE = 900


def take(source, what, patience=PATIENCE):
    """The next of a queue for which `what` is true, and those before it; `patience` in seconds."""
    deadline = time.monotonic() + patience
    before = []
    while True:
        try:
            item = source.get(timeout=max(0, deadline - time.monotonic()))
        except queue.Empty:
            raise AssertionError(f"not what was waited for; last: {before[-8:]}") from None
        if what(item):
            return item, before
        before.append(item)


def equal(what, seen, wanted):
    assert seen == wanted, f"{what}: {seen!r}, not {wanted!r}"
