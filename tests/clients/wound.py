"""Runs a script whose client winds the simulator's clock: SCRIPT [ARGUMENT...], the URL of the control interface in CLOCK.

A client that the machine holds up must not lose a valve that it keeps active. The simulator runs with `--speed step`, and its
time passes while this process runs: both clocks stand still together.
"""

import contextlib
import http.client
import os
import pathlib
import runpy
import sys
import threading
import time
import traceback
import urllib.parse

import canopen
from waiting import PATIENCE, equal

#: A quarter of the speed of the wall clock: another thread of this process may come a second late, too.
SPEED = 0.25
#: Between two advances, seconds of the wall clock.
TICK = 0.008
#: The most that passes at once, milliseconds of virtual time, however late the machine is: much less than a time guard.
LONGEST_MS = 20
#: Devices start within the first milliseconds: a script joins a bus that is at work.
START_MS = 5


class Clock:
    def __init__(self, url):
        self.connection = http.client.HTTPConnection(urllib.parse.urlsplit(url).netloc, timeout=PATIENCE)

    def advance(self, ms):
        try:
            status, said = self.ask(ms)
        except (http.client.HTTPException, OSError):
            # the simulator closes a connection that stood still for too long
            self.connection.close()
            status, said = self.ask(ms)
        equal(f"status of {said}", status, 200)

    def ask(self, ms):
        self.connection.request("POST", "/api/v1/time", b'{"advance_ms": %d}' % ms, {"Content-Type": "application/json"})
        answer = self.connection.getresponse()
        return answer.status, answer.read()

    def wind(self, ended):
        try:
            last = time.monotonic()
            while not ended.wait(TICK):
                now = time.monotonic()
                self.advance(min(LONGEST_MS, max(1, round((now - last) * 1000 * SPEED))))
                last = now
        except Exception:
            # nothing comes any more of what the script waits for
            traceback.print_exc()
            os._exit(1)


@contextlib.contextmanager
def wound(url):
    """Time passes as long as the context."""
    clock = Clock(url)
    clock.advance(START_MS)
    ended = threading.Event()
    thread = threading.Thread(target=clock.wind, args=[ended], daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join(PATIENCE)


if __name__ == "__main__":
    script = sys.argv[1]
    del sys.argv[0]
    sys.path.insert(0, str(pathlib.Path(script).resolve().parent))
    # examples keep the patience of python-canopen, 0.3 s of the wall clock, which a busy machine exceeds
    canopen.sdo.client.SdoClient.RESPONSE_TIMEOUT = PATIENCE
    with wound(os.environ["CLOCK"]):
        runpy.run_path(script, run_name="__main__")
