"""A tractor claims an address beside the valve, finds out who that is, and what it does not know."""

import j1939

from tractor import ACKNOWLEDGEMENT, ALL, CLAIM, TRACTOR, UNSUPPORTED, VALVE, VALVE_NAME, AVEF
from tractor import claimed, connected, equal, name_bytes, take

PERIOD_MS = 100

with connected() as (tractor, ear):
    frame = ear.expect(claimed(TRACTOR))
    equal("the tractor's NAME", bytes(frame.data), name_bytes(tractor.name))
    tractor.wait_until_claimed()
    # the valve says nothing but its claim before that
    ear.expect_flow("blocked")

    # an addressed request, then one to all: the valve answers both
    for destination in (VALVE, ALL):
        tractor.request(CLAIM, destination)
        frame = ear.expect(claimed(VALVE))
        equal("the valve's NAME", bytes(frame.data), VALVE_NAME)
    name = j1939.Name(bytes=frame.data)
    equal("manufacturer", name.manufacturer_code, 57)
    equal("function", (name.function, name.function_instance), (255, 1))
    equal("vehicle system", (name.vehicle_system, name.vehicle_system_instance), (1, 0))
    equal("industry group", name.industry_group, 2)
    equal("arbitrary address capable", name.arbitrary_address_capable, 0)
    equal("identity", name.identity_number, 1)

    # not supported: refused when asked alone, no word when all are asked
    tractor.request(UNSUPPORTED, ALL)
    tractor.request(UNSUPPORTED)
    refusal = tractor.expect(ACKNOWLEDGEMENT)
    equal("refusal", refusal, bytes([1, 0xFF, 0xFF, 0xFF, TRACTOR, 0xEB, 0xFE, 0x00]))
    tractor.request(CLAIM)
    ear.expect(0x18E8FF00 | VALVE, refusal)
    ear.expect(claimed(VALVE), without=[0x18E8FF00 | VALVE])

    # the estimated flow comes every 100 ms, and on request
    frames = [ear.expect(AVEF.frame_id) for _ in range(11)]
    gaps = [(b.timestamp - a.timestamp) * 1000 for a, b in zip(frames, frames[1:])]
    # a frame that is on the bus already makes the next one late, by its length at the most
    assert all(abs(gap - PERIOD_MS) < 1 for gap in gaps), f"AVEF every {gaps} ms"
    tractor.request(0xFE10 | VALVE & 0xF)
    _, before = take(ear.frames, lambda frame: frame.arbitration_id == 0x18EA0000 | VALVE << 8 | TRACTOR)
    last = [frame for frame in [frames[-1], *before] if frame.arbitration_id == AVEF.frame_id][-1]
    around = [frame.timestamp for frame in [last, *(ear.expect(AVEF.frame_id) for _ in range(2))]]
    gaps = [later - earlier for earlier, later in zip(around, around[1:])]
    assert min(gaps) < 0.099, f"{gaps} s: the request is answered beside the cycle"
