"""Draws the step response of boom.py from a log of pve-sim: step_response.py LOG DEGREES > boom.svg."""

import sys

WIDTH, HEIGHT, LEFT, TOP = 640, 130, 60, 30
COLOURS = "#1f6fb4", "#b4501f"


def curve(points, duration, low, high, top, colour):
    def place(at, value):
        return f"{LEFT + at / duration * WIDTH:.1f},{top + (high - value) / (high - low) * HEIGHT:.1f}"

    line = " ".join(place(at, value) for at, value in points)
    return f'<polyline fill="none" stroke="{colour}" stroke-width="2" points="{line}"/>'


def panel(title, unit, points, duration, low, high, step, top, colour):
    yield f'<text x="{LEFT}" y="{top - 8}" fill="{colour}">{title}</text>'
    for value in range(low, high + 1, step):
        y = top + (high - value) / (high - low) * HEIGHT
        yield f'<line x1="{LEFT}" x2="{LEFT + WIDTH}" y1="{y:.1f}" y2="{y:.1f}" stroke="#ccc"/>'
        yield f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{value}{unit}</text>'
    yield curve(points, duration, low, high, top, colour)


if len(sys.argv) != 3:
    sys.exit(__doc__)
log, wanted = sys.argv[1], float(sys.argv[2])
angles, openings, start = [], [], None
for line in open(log):
    time, _, frame = line.split()[:3]
    cob_id, data = frame.split("#")
    if cob_id == "000":
        start = float(time[1:-1])
    elif start and cob_id == "181":
        angles.append((float(time[1:-1]) - start, int.from_bytes(bytes.fromhex(data), "little") * 360 / 16384))
    elif start and cob_id == "1A0":
        position = int.from_bytes(bytes.fromhex(data)[2:], "little", signed=True)
        openings.append((float(time[1:-1]) - start, position / 163.84))

if not angles:
    sys.exit(f"{log}: no frame 181 after an NMT start")
duration = angles[-1][0]
bottom = TOP + 2 * HEIGHT + 50
svg = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {LEFT + WIDTH + 20} {bottom + 40}" font-family="sans-serif" font-size="12">']
svg += ['<rect width="100%" height="100%" fill="white"/>']
svg += [curve([(0, wanted), (duration, wanted)], duration, 0, 90, TOP, "#999")]
svg += panel("angle of the boom (TPDO of hat1000)", "°", angles, duration, 0, 90, 30, TOP, COLOURS[0])
svg += panel("spool (TPDO of pvea-canopen)", " %", openings, duration, -50, 100, 50, TOP + HEIGHT + 50, COLOURS[1])
for second in range(int(duration) + 1):
    x = LEFT + second / duration * WIDTH
    svg += [f'<text x="{x:.1f}" y="{bottom + 18}" text-anchor="middle">{second} s</text>']
print("\n".join(svg + ["</svg>"]))
