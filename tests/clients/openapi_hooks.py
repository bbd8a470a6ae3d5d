"""What of its calls schemathesis cannot know: the names of the devices, and that time is money."""

import schemathesis

SENSOR = {"angle_cdeg", "speed_rpm", "measuring_error"}
#: The most that is waited for, or destroyed.
MOST = 50


@schemathesis.hook
def before_call(context, case, kwargs):
    body = case.body if isinstance(case.body, dict) else {}
    if case.path_parameters:
        case.path_parameters["name"] = "angle" if SENSOR & body.keys() else "boom"
    if isinstance(body.get("device"), str):
        body["device"] = "boom"
    # OpenAPI has no words for a parameter that depends on another one.
    if case.path == "/bus/frames" and case.query and case.query.get("extended") in (True, False, "true", "false"):
        del case.query["extended"]
    # Weeks of virtual time and millions of frames are right, and would be waited for.
    for key in ("within_ms", "advance_ms", "frames"):
        given = body.get(key)
        if isinstance(given, (int, float)) and MOST < given < 2**32 and (key == "within_ms" or given == int(given)):
            body[key] = MOST
