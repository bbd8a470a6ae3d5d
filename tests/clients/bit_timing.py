"""Another bit rate by LSS: once the valve has changed to it, a client at the old one is deaf and disturbed.

HOST PORT CHANNEL PHASE: the phases are run one after the other, each on a process of its own with the same state.
"""

import sys
import time

from canopen import SdoCommunicationError
from canopen.lss import LssError

from valve import NODE_ID, PATIENCE, connected, equal

KBIT_500 = 2
DELAY_MS = 50
#: Longest wait for an answer that nobody is to give, seconds: then the client asks again, until it is disturbed.
SILENCE = 0.2


def configure(valve):
    """To 500 kbit/s, not yet in force."""
    lss = valve.network.lss
    valve.node.nmt.state = "STOPPED"
    lss.send_switch_state_global(lss.CONFIGURATION_STATE)
    for index in (0, 1, 5, 8, 0xFF):
        try:
            lss.configure_bit_timing(index)
        except LssError as error:
            equal(f"refusal of {index}", str(error), "LSS Error: 1")
        else:
            raise AssertionError(f"took bit timing {index}")
    lss.configure_bit_timing(KBIT_500)
    # it answers still
    equal("node ID", lss.inquire_node_id(), NODE_ID)


def expect_silence(valve):
    """Nobody answers, and what the client sends is disturbed."""
    valve.heard.forget()
    valve.node.sdo.RESPONSE_TIMEOUT = SILENCE
    deadline = time.monotonic() + PATIENCE
    heard = []
    while not heard:
        assert time.monotonic() < deadline, "nothing is disturbed"
        try:
            valve.node.sdo[0x1000].raw
        except SdoCommunicationError:
            pass
        else:
            raise AssertionError("an answer, at another bit rate")
        heard = valve.heard.all()
    assert all(frame.is_error_frame for frame in heard), f"{heard}"


def activate(valve):
    configure(valve)
    valve.network.lss.activate_bit_timing(DELAY_MS)
    # the first read falls into the delay, in which it hears, disturbs nobody, and says nothing
    expect_silence(valve)


def forgotten(valve):
    """What was not stored is gone with the power; this time it is stored."""
    equal("1000", valve.node.sdo[0x1000].raw, 0x198)
    configure(valve)
    valve.network.lss.store_configuration()
    # stored is not in force
    equal("node ID", valve.network.lss.inquire_node_id(), NODE_ID)


def deaf(valve):
    expect_silence(valve)


def found(valve):
    equal("1000", valve.node.sdo[0x1000].raw, 0x198)
    valve.reset()
    equal("1000", valve.node.sdo[0x1000].raw, 0x198)


PHASES = {"activate": activate, "forgotten": forgotten, "deaf": deaf, "found": found}

with connected() as valve:
    PHASES[sys.argv[4]](valve)
