"""Injects each fault of two valves and waits for the reaction: a pattern for a test in CI. Time is stepped, so
that no call sleeps and all runs are equal.

    pve-sim --speed step --device pvea-canopen@0x20,name=boom --device pvea-isobus@0x80,name=arm
    python3 examples/faults.py http://127.0.0.1:8408
"""

import json
import sys
import urllib.error
import urllib.request

API = (sys.argv[1] if len(sys.argv) > 1 else "http://127.0.0.1:8408").rstrip("/") + "/api/v1"

HEALTHY = {
    "supply_mv": 24000, "temperature_c": 25, "spool": {"fault": None}, "internal_fault": False,
    "memory": "ok", "bus_off": False,
}


def call(method, path, body=None):
    """Returns the answer to a call; ends the script if the call is refused, or nobody listens."""
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(API + path, data, {"Content-Type": "application/json"}, method=method)
    try:
        with urllib.request.urlopen(request) as answer:
            return json.load(answer)
    except urllib.error.HTTPError as error:
        sys.exit(f"{method} {path} {body}: {error.code} {error.read().decode()}")
    except urllib.error.URLError as error:
        sys.exit(f"{API}: {error.reason}")


class Valve:
    """A valve and its master."""

    def __init__(self, name, cob_id, extended, half, back, float_):
        self.name, self.cob_id, self.extended = name, cob_id, extended
        self.half, self.back, self.float = half, back, float_

    def plant(self, **change):
        return call("PATCH", f"/devices/{self.name}/plant", change)

    def power(self, **change):
        return call("POST", f"/devices/{self.name}/power", change)

    def wait(self, within_ms=5000, **state):
        return call("POST", "/wait", {"device": self.name, "state": state, "within_ms": within_ms})

    def follow(self, set_point):
        """Sends a set-point every 100 ms, as the master does."""
        call("DELETE", "/bus/frames")
        frame = {"id": self.cob_id, "extended": self.extended, "data": set_point, "every_ms": 100}
        call("POST", "/bus/frames", frame)

    def at_work(self):
        """Restores the plant, restarts the valve, and drives the spool to half its stroke."""
        call("DELETE", "/bus/frames")
        self.power(on=False)
        self.plant(**HEALTHY)
        self.power(on=True)
        call("POST", "/time", {"advance_ms": 50})
        if not self.extended:
            call("POST", "/bus/frames", {"id": 0, "data": "0120"})
        self.follow(self.half)
        self.wait(position=8192, solenoids=True, faults=[])

    def shuts_down(self, fault, since, within_us):
        """Waits until the valve reports this fault alone and releases the spool, and checks the time."""
        state = self.wait(faults=[fault], led={"color": "red"}, solenoids=False)
        assert state["t_us"] - since <= within_us, (fault, state["t_us"] - since)
        print(f"{self.name}: {fault} after {(state['t_us'] - since) / 1000:g} ms")


VALVES = [
    Valve("boom", 0x220, False, "0F000020", "0F0000C0", "0F00FF7F"),
    Valve("arm", 0x0CFE3027, True, "7DFF31FFFFFFFFFF", "FAFF32FFFFFFFFFF", "00FF33FFFFFFFFFF"),
]

for valve in VALVES:
    for fault, change, delay_us in [
        ("supply-low", {"supply_mv": 8000}, 2_000_000),
        ("supply-high", {"supply_mv": 40000}, 2_000_000),
        ("temperature", {"temperature_c": 130}, 250_000),
        ("internal", {"internal_fault": True}, 0),
        ("can-bus", {"bus_off": True}, 0),
    ]:
        valve.at_work()
        valve.shuts_down(fault, valve.plant(**change)["t_us"], delay_us)

    valve.at_work()
    since = valve.plant(spool={"fault": "stuck"})["t_us"]
    valve.follow(valve.back)
    valve.shuts_down("spool-not-at-set-point", since, 700_000)

    valve.at_work()
    since = valve.plant(spool={"fault": "no-float"})["t_us"]
    valve.follow(valve.float)
    valve.shuts_down("float-not-reached", since, 2_000_000)

    valve.at_work()
    call("DELETE", "/bus/frames")
    valve.shuts_down("time-guarding", call("GET", "/time")["now_us"], 250_000)

    valve.at_work()
    call("DELETE", "/bus/frames")
    valve.plant(memory="damaged")
    valve.shuts_down("internal", valve.power(reset="watchdog")["t_us"], 1_000)
