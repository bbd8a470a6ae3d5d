"""The control interface, for scripts that break what they talk to."""

import contextlib
import http.client
import json
import time
import urllib.parse

from waiting import PATIENCE, equal


class Control:
    """The control interface at this URL."""

    def __init__(self, url):
        self.netloc = urllib.parse.urlsplit(url).netloc

    def call(self, method, path, body=None):
        """The answer to a request, which must succeed."""
        connection = http.client.HTTPConnection(self.netloc, timeout=PATIENCE)
        with contextlib.closing(connection):
            headers = {"Content-Type": "application/json"}
            connection.request(method, f"/api/v1{path}", None if body is None else json.dumps(body), headers)
            answer = connection.getresponse()
            said = answer.read()
        assert answer.status == 200, f"{method} {path} {body}: {answer.status} {said}"
        return json.loads(said)

    def plant(self, device, **words):
        self.call("PATCH", f"/devices/{device}/plant", words)

    def power(self, device, on):
        self.call("POST", f"/devices/{device}/power", {"on": on})

    def struck(self, name):
        """The number of frames that a communication fault has affected so far."""
        (fault,) = [fault for fault in self.call("GET", "/bus/faults") if fault["name"] == name]
        return fault["struck"]

    @contextlib.contextmanager
    def fault(self, **keys):
        """A communication fault as long as the context, and until it has affected a frame, or as many as it counts."""
        name = self.call("POST", "/bus/faults", keys)["name"]
        yield
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline and self.struck(name) < keys.get("count", 1):
            pass
        (ended,) = self.call("DELETE", f"/bus/faults/{name}")
        assert ended["struck"] > 0, f"no frame was affected: {ended}"
        if "count" in keys:
            equal(f"affected by {name}", ended["struck"], keys["count"])
