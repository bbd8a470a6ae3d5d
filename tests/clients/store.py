"""Stores parameters, finds them after a restart of the process, restores the defaults, finds those after another.

HOST PORT CHANNEL PHASE: the phases are run in the order of PHASES, each on a process of its own with the same state.
"""

import sys

from valve import NODE_ID, connected, equal

PRE_OPERATIONAL = bytes([0x7F])
PERIOD_MS, NAME = 100, "BOOM LEFT"
DEFAULT_NAME = "PVEA-CI S6"


def parameters(node):
    return node.sdo[0x1017].raw, node.sdo[0x6053].raw


def store(valve):
    node = valve.node
    equal("defaults", parameters(node), (0, DEFAULT_NAME))
    node.sdo[0x1017].raw = PERIOD_MS
    node.sdo[0x6053].raw = NAME
    node.store()
    # what is written after the store is not stored
    node.sdo[0x6053].raw = "LOST"
    equal("unsaved", parameters(node), (PERIOD_MS, "LOST"))


def found(valve):
    node = valve.node
    equal("stored", parameters(node), (PERIOD_MS, NAME))
    valve.heard.forget()
    first = valve.heard.expect(0x700 + NODE_ID, PRE_OPERATIONAL)
    second = valve.heard.expect(0x700 + NODE_ID, PRE_OPERATIONAL)
    period = round((second.timestamp - first.timestamp) * 1000)
    assert abs(period - PERIOD_MS) <= 1, f"{period} ms"

    # "load" waits for the next start, and a "save" in between does not call it off
    node.restore()
    equal("before the restart", parameters(node), (PERIOD_MS, NAME))
    node.store()


def restored(valve):
    equal("restored", parameters(valve.node), (0, DEFAULT_NAME))
    # the start has stored the defaults: the next one does not need the flag
    valve.reset()
    equal("restored for good", parameters(valve.node), (0, DEFAULT_NAME))


PHASES = {"store": store, "found": found, "restored": restored}

with connected() as valve:
    PHASES[sys.argv[4]](valve)
