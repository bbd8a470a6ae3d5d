#!/usr/bin/env python3
"""Random traffic to a device and to its plain model; the first difference is shrunk and printed. See README.md."""

import argparse
import os
import pathlib
import random
import struct
import sys
import time

import canopen
import hat
import isobus
import valve
from bus import Bus

ROOT = pathlib.Path(__file__).resolve().parents[2]
#: Frames of the device for one sent, at the least: below, it was not heard, and nothing was compared.
ANSWERS = 0.2
#: Episodes that may be broken off because the model does not know enough, of all.
UNDECIDED = 0.05


class Difference(Exception):
    """Device and model disagree."""


class Run:
    """One device, its model, and what was done to both."""

    def __init__(self, kind, executable):
        self.bus = Bus(executable, kind)
        self.model = MODELS[kind](kind)
        self.done, self.log, self.requests, self.answers = [], [], 0, 0
        self.undecided = False

    def step(self, step):
        """Does one step: `("frames", [(id, data)], ms)`, `("cycle", (id, data), ms, count)`, `("plant", {...})`, `("power",)`
        or `("state",)`."""
        self.done.append(step)
        if step[0] == "frames":
            self.requests += len(step[1])
            self.compare(*self.bus.play(step[1], step[2]))
        elif step[0] == "cycle":
            now, log = self.bus.cycle(*step[1:])
            self.requests += sum(not from_device for _, from_device, _, _ in log)
            self.compare(now, log)
        elif step[0] == "plant":
            state = self.bus.call("PATCH", "/devices/dut/plant", step[1])
            self.log.append(f"{state['t_us'] / 1000:10.3f}    plant {step[1]}")
            self.model.set_plant(state["t_us"], step[1])
        elif step[0] == "power":
            # Longer than the fault log is held back.
            self.compare(*self.bus.play([], 11_000))
            for on in (False, True):
                at = self.bus.call("POST", "/devices/dut/power", {"on": on})["t_us"]
            self.log.append(f"{at / 1000:10.3f}    power off and on")
            self.model.power_cut(at)
            self.compare(*self.bus.play([], 300))
        elif step[0] == "state":
            state = self.bus.state()
            self.model.advance(state["t_us"])
            for field, value in self.model.state().items():
                if state[field] != value:
                    raise Difference(f"{field} is {state[field]!r}, the model has {value!r}")

    def compare(self, now, log):
        model = self.model
        for at, from_device, identifier, data in log:
            self.log.append(f"{at / 1000:10.3f} {'←' if from_device else '→'} {canopen.written(identifier, data)}")
            # Frames of two senders under one identifier destroy each other, which is not seen here.
            shared = not from_device and any(due.identifier == identifier for due in model.expected)
            model.occupied(at, identifier, data, shared)
            model.advance(at)
            for due in model.expected:
                if model.late(due):
                    raise Difference(f"late: {due}")
            if not from_device:
                model.receive(at, identifier, data)
                continue
            self.answers += 1
            model.hear(at, identifier, data)
            waiting = [e for e in model.expected if e.identifier == identifier]
            if not waiting:
                raise Difference(f"{canopen.written(identifier, data)} is not expected")
            # The first that has to come, or one before it that may.
            must = next((i for i, e in enumerate(waiting) if not e.optional and e.within <= canopen.BUS_US), len(waiting) - 1)
            due = next((e for e in reversed(waiting[: must + 1]) if e.matches(data)), waiting[must])
            if not due.matches(data):
                raise Difference(f"{canopen.written(identifier, data)}, the model has {due}")
            model.expected.remove(due)
        model.advance(now)
        if model.restart_by < now:
            raise Difference("no boot-up after a reset")
        model.expected = [due for due in model.expected if not due.optional or due.due + due.within >= now]
        for due in model.expected:
            if due.due + due.within < now:
                raise Difference(f"not sent: {due}")


class Traffic:
    """Random steps, legal and hostile; looks at the model to find identifiers and values that are worth sending."""

    def __init__(self, run, dice):
        self.run, self.model, self.dice = run, run.model, dice

    def next(self):
        choices, weights = zip(*self.choices())
        return self.dice.choices(choices, weights)[0]()

    def choices(self):
        if not isinstance(self.model, valve.Valve):
            return [
                (self.sdo_batch, 30), (self.nmt, 6), (self.lss_batch, 8), (self.pass_time, 8), (self.configure, 10),
                (self.sync, 10), (self.everything, 1), (self.memory, 3), (self.plant, 5), (lambda: [("state",)], 2),
                (lambda: [("power",)], 0.5),
            ]  # fmt: skip
        return [
            (self.sdo_batch, 30), (self.nmt, 3), (self.lss_batch, 4), (self.pass_time, 4), (self.configure, 8),
            (self.rpdo, 12), (self.sync, 8), (self.everything, 1), (self.memory, 2), (self.noise, 3),
            (self.plant, 3), (self.drive, 4), (lambda: [("state",)], 2), (lambda: [("power",)], 0.3),
        ]  # fmt: skip

    def frames(self, frames, milliseconds=None):
        return [("frames", frames, milliseconds or int(len(frames) * 1.3) + 3)]

    def sdo(self, *data):
        return 0x600 + self.model.node, bytes(data).ljust(8, b"\0")

    def upload(self, index, sub):
        return self.sdo(0x40, index & 0xFF, index >> 8, sub)

    def download(self, index, sub, value, size=4):
        data = (value & (1 << 8 * size) - 1).to_bytes(size, "little")
        return self.sdo(0x23 | (4 - size) << 2, index & 0xFF, index >> 8, sub, *data)

    def size(self, index, sub):
        try:
            return canopen.SIZES.get(self.model.entry(index, sub)[0], 4)
        except canopen.Abort:
            return self.dice.choice((1, 2, 4))

    def address(self):
        dice = self.dice
        if dice.random() < 0.04:
            return dice.choice((0x2000, 0x0001, 0x0005, 0x1002, 0x1015, 0x1029, 0x1401, 0x1801, 0x5FFF, dice.randrange(1 << 16))), 0
        index = dice.choice(self.model.indices)
        subs = list(self.model.objects(index) or [0])
        if dice.random() < 0.08:
            return index, dice.choice((1, 2, 3, 4, 5, 6, 8, 9, 0xFF))
        return index, dice.choice(subs)

    def value(self, index, sub):
        dice = self.dice
        # A random bit rate would be stored, and the device not heard any more.
        if dice.random() < 0.1 and index != 0x2002:
            return dice.getrandbits(32)
        return dice.choice(self.model.worth(index, sub, dice))

    def requests(self):
        """One transfer, mostly whole."""
        dice, (index, sub) = self.dice, self.address()
        what = dice.random()
        if what < 0.35:
            result = [self.upload(index, sub)]
            if self.model.is_text(index) or dice.random() < 0.02:
                toggle = 0
                for _ in range(dice.choice((1, 2, 3, 7, 8))):
                    result.append(self.sdo(0x60 | toggle << 4))
                    if dice.random() > 0.04:
                        toggle ^= 1
            return result
        if index in (0x1010, 0x1011) and what < 0.95:
            value = dice.choice((0, 1, 0x65766174, 0x73646B71))
            return [self.download(index, sub, value)]
        value = self.value(index, sub)
        size = self.size(index, sub) if dice.random() > 0.05 else dice.randrange(1, 5)
        if index in (0x1010, 0x1011) and value in (canopen.SAVE, canopen.LOAD, canopen.CLEAR):
            return []
        if what < 0.75:
            if dice.random() < 0.1 and not self.model.is_text(index):
                return [self.sdo(0x22, index & 0xFF, index >> 8, sub, *struct.pack("<I", value & 0xFFFFFFFF))]
            return [self.download(index, sub, value, size)]
        if what < 0.93:
            text = dice.randbytes(dice.randrange(1, 15)) if self.model.is_text(index) else struct.pack("<I", value & 0xFFFFFFFF)[:size]
            announced = len(text) + (dice.choice((-1, 1, 7)) if dice.random() < 0.05 else 0)
            command = dice.choice((0x21, 0x20))
            result = [self.sdo(command, index & 0xFF, index >> 8, sub, *struct.pack("<I", announced if command & 1 else 0))]
            toggle = 0
            while text:
                part, text = text[:7], text[7:]
                if text and dice.random() < 0.1:
                    part, text = part[:3], part[3:] + text
                result.append(self.sdo(toggle << 4 | (7 - len(part)) << 1 | (not text), *part))
                if dice.random() > 0.03:
                    toggle ^= 1
            return result[: dice.randrange(1, len(result) + 1)] if dice.random() < 0.15 else result
        command = dice.choice((0x00, 0x10, 0x01, 0x60, 0x70, 0x80, 0xA0, 0xA1, 0xA2, 0xA3, 0xC0, 0xC2, 0xC6, 0xE0))
        frame = self.sdo(command, index & 0xFF, index >> 8, sub, *dice.randbytes(4))
        return [(frame[0], frame[1][: dice.randrange(8)] if dice.random() < 0.1 else frame[1])]

    def sdo_batch(self):
        frames = []
        for _ in range(self.dice.choice((1, 3, 10, 30))):
            frames += self.requests()
        return self.frames(frames) if frames else []

    def nmt(self):
        dice = self.dice
        command = dice.choice((1, 1, 1, 1, 2, 0x80, 0x80, 0x81, 0x82, 0, 3, 0x83))
        node = dice.choice((0, self.model.node, self.model.node, self.model.node, self.model.node ^ 1))
        return self.frames([(0, bytes([command, node]))], 300)

    def lss_batch(self):
        dice, model = self.dice, self.model
        lss = lambda *data: (0x7E5, bytes(data).ljust(8, b"\0"))  # noqa: E731
        if model.node == 255 and dice.random() < 0.3:
            join = [lss(4, 1), lss(0x11, 5), lss(0x17)], [lss(4, 0)]
            return self.frames(join[0], 500) + self.frames(join[1], 300)
        frames = []
        for _ in range(dice.choice((1, 2, 6, 12))):
            what = dice.randrange(12)
            if what == 0:
                frames += [lss(0x40 + i, *struct.pack("<I", n)) for i, n in enumerate(model.identity)]
            elif what == 1:
                frames.append(lss(0x40 + dice.randrange(4), *struct.pack("<I", dice.choice(model.identity))))
            elif what in (2, 3):
                frames.append(lss(4, 1))
            elif what == 4:
                frames.append(lss(4, dice.choice((0, 2, 255))))
                return self.frames(frames, 300)
            elif what == 5:
                frames.append(lss(0x11, dice.choice((0x20, 0x21, 0x11, 1, 127, 0, 128, 255))))
            elif what == 6:
                selector, index = dice.choice(((0, model.rate), (0, model.rate), (1, 2), (0, 9), (0, 5), (255, 3)))
                frames.append(lss(0x13, selector, index))
            elif what == 7:
                frames.append(lss(0x17))
                return self.frames(frames, 500)
            elif what in (8, 9):
                frames.append(lss(dice.randrange(0x5A, 0x60)))
            elif what == 10:
                frames.append(lss(dice.choice((0x4C, 0x51, 0x46, 0x4B, 0x00, 0xFF)), *dice.randbytes(7)))
            else:
                frame = lss(4, 1)
                frames.append((frame[0], frame[1][: dice.randrange(8)]))
        return self.frames(frames, len(frames) * 2 + 30)

    def pass_time(self):
        return self.frames([], self.dice.choice((1, 7, 50, 249, 251, 1000, 2100, 5100)))

    def everything(self):
        """Reads every object."""
        frames = []
        for index in self.model.indices:
            for sub in self.model.objects(index):
                frames.append(self.upload(index, sub))
                if self.model.is_text(index):
                    frames += [self.sdo(0x60 | i % 2 << 4) for i in range(7)]
        return self.frames(frames)

    def memory(self):
        index, sub, value = self.dice.choice(self.model.memory_commands)
        frames = [self.download(index, sub, value)]
        if self.dice.random() < 0.4:
            # What needs no memory is answered meanwhile.
            frames += [self.sdo(self.dice.choice((0x00, 0x60, 0xA0, 0xC0, 0xE0)), index & 0xFF, index >> 8, sub)] * 2
        return self.frames(frames, 500)

    def configure(self):
        """Maps a PDO as tools do, now and then with a mistake."""
        dice, model = self.dice, self.model
        pdo = dice.choice(model.pdos)
        mapping, cob = pdo + 0x200, dice.choice((0x181, 0x1A0, 0x1F0, 0x220, 0x2A0, 0x333, 0x480, 0x7F, 0x6FF))
        entries = [dice.choice(model.worth(mapping, 1, dice)) for _ in range(dice.choice((0, 1, 2, 2, 3, 4, 8)))]
        frames = [self.download(pdo, 1, 0x80000000 | cob), self.download(mapping, 0, 0, 1)]
        frames += [self.download(mapping, i + 1, entry) for i, entry in enumerate(entries)]
        frames += [self.download(mapping, 0, len(entries), 1)]
        frames += [self.download(pdo, 2, dice.choice(model.worth(pdo, 2, dice)), 1), self.download(pdo, 1, cob)]
        if dice.random() < 0.3:
            frames.pop(dice.randrange(len(frames)))
        if dice.random() < 0.3:
            at = dice.randrange(len(frames) - 1)
            frames[at], frames[at + 1] = frames[at + 1], frames[at]
        return self.frames(frames)

    def drive(self):
        """Steps of the device state machine, legal ones."""
        model, dice = self.model, self.dice
        frames = [(0, bytes([1, model.node]))]
        for word in dice.choice(((15, 15, 15), (3, 11, 15), (11, 15), (15, 15, 15, 3), (15, 3, 0, 0))):
            frames.append(self.download(0x6040, 0, word, 2))
        if dice.random() < 0.7:
            frames.append(self.download(0x6300, 1, dice.choice((0, 5000, -16384, valve.FLOAT)), 2))
        # Now and then the set-point is kept up, for a second and more.
        again = self.upload(0x6300, 1), self.download(0x6300, 1, dice.choice((5000, -16384, valve.FLOAT, 2457, 2458)), 2)
        return self.frames(frames) + self.frames(list(again), 200) * dice.choice((0, 0, 3, 6))

    def rpdo(self):
        dice, model = self.dice, self.model
        size = (sum(entry & 0xFF for entry in model.entries(0x1600)) + 7) // 8
        data = bytearray(dice.randbytes(8))
        if dice.random() < 0.8:
            bits = at = 0
            for entry in model.entries(0x1600):
                index, sub, length = entry >> 16, entry >> 8 & 0xFF, entry & 0xFF
                bits |= (dice.choice(model.worth(index, sub, dice)) & (1 << length) - 1) << at
                at += length
            data = bytearray(bits.to_bytes(max((at + 7) // 8, 8), "little")[:8])
        length = min(8, size) if dice.random() < 0.8 else dice.randrange(9)
        return self.frames([(model.values[0x1400, 1] & 0x7FF, bytes(data[:length]))], dice.choice((2, 2, 2, 20, 240)))

    def sync(self):
        cob = self.model.values[0x1005, 0] & 0x7FF
        return self.frames([(cob, b"")], 2) * self.dice.choice((1, 2, 5))

    def noise(self):
        dice = self.dice
        identifier = dice.choice((0x80, 0xC5, 0x100, 0x333, 0x7FF, dice.randrange(0x800), 1 << 31 | dice.getrandbits(29)))
        if identifier == 0:
            return []
        data = b"\0\x10" + bytes(6) if dice.random() < 0.5 else dice.randbytes(dice.randrange(9))
        return self.frames([(identifier, data)])

    def plant(self):
        model = self.model
        if isinstance(model, valve.Valve) and model.dsm != "active" and model.position() == 0 and self.dice.random() < 0.3:
            return [("plant", {"spool": {"fault": None if model.stuck else "stuck"}})]
        if self.dice.random() < 0.1:
            # More errors than the history holds.
            return [("plant", dict(internal_fault=on)) for on in (True, False)] * self.dice.choice((4, 5))
        return [("plant", self.dice.choice(model.plants))]


MODELS = {
    "pvea-canopen": valve.Valve,
    "pveo-canopen": valve.Valve,
    "hat1000": hat.Sensor,
    "hat3000": hat.Sensor,
    "pvea-isobus": isobus.Valve,
    "pveo-isobus": isobus.Valve,
}


def play(kind, executable, steps):
    """Plays recorded steps; returns the run and the difference, if there is one."""
    run = Run(kind, executable)
    try:
        for step in steps:
            run.step(step)
    except Difference as difference:
        return run, difference
    finally:
        run.bus.close()
    return run, None


def search(kind, executable, seed, requests):
    dice = random.Random(f"{kind} {seed}")
    run = Run(kind, executable)
    traffic = run.model.traffic(run, dice) if hasattr(run.model, "traffic") else Traffic(run, dice)
    try:
        run.step(("frames", [], 400 if kind.endswith("isobus") else 20))
        while run.requests < requests:
            for step in traffic.next():
                run.step(step)
    except Difference as difference:
        return run, difference
    except canopen.Undecided:
        run.undecided = True
    finally:
        run.bus.close()
    return run, None


def without(steps, start, count):
    return steps[:start] + steps[start + count :]


def shrink(kind, executable, steps, difference, seconds=60):
    """Returns the shortest steps found that still end in a difference."""
    end = time.monotonic() + seconds
    sort = str(difference)[:16]

    def fails(candidate):
        if time.monotonic() > end:
            return False
        try:
            run, found = play(kind, executable, candidate)
        except (RuntimeError, EOFError, ValueError, KeyError, canopen.Undecided):
            return False
        return found is not None and str(found)[:16] == sort

    single = []
    for step in steps:
        single += [("frames", [step[1]], step[2])] * step[3] if step[0] == "cycle" else [step]
    if fails(single):
        steps = single
    size = max(1, len(steps) // 2)
    while size:
        at = len(steps) - size
        while at >= 1:
            candidate = without(steps, at, size)
            if candidate and fails(candidate):
                steps = candidate
            at = min(at, len(steps)) - size
        size //= 2
    for number in range(len(steps)):
        if steps[number][0] != "frames":
            continue
        least = int(len(steps[number][1]) * 1.3) + 3
        for milliseconds in (least, least + 30, least + 300):
            candidate = [*steps[:number], ("frames", steps[number][1], milliseconds), *steps[number + 1 :]]
            if milliseconds < steps[number][2] and fails(candidate):
                steps = candidate
                break
        size = max(1, len(steps[number][1]) // 2)
        while size:
            at = 0
            while at < len(steps[number][1]):
                frames = without(steps[number][1], at, size)
                candidate = [*steps[:number], ("frames", frames, steps[number][2]), *steps[number + 1 :]]
                if fails(candidate):
                    steps = candidate
                else:
                    at += size
            size //= 2
    return steps


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kind", choices=[*MODELS], action="append", help="a kind of device; all of them by default")
    parser.add_argument("--seed", type=int, help="the seed of the first run; by default a new one")
    parser.add_argument("--requests", type=int, default=100_000, help="frames sent to each kind")
    parser.add_argument("--episode", type=int, default=3_000, help="frames until a new device begins")
    parser.add_argument("--keep-going", action="store_true", help="looks for more after a difference")
    arguments = parser.parse_args()
    executable = os.environ.get("PVE_SIM") or str(ROOT / os.environ.get("CARGO_TARGET_DIR", "target") / "debug/pve-sim")
    first = arguments.seed if arguments.seed is not None else random.SystemRandom().randrange(1 << 32)
    failed = False
    for kind in arguments.kind or MODELS:
        begin, sent, answers, undecided, seed = time.monotonic(), 0, 0, 0, first
        while sent < arguments.requests:
            run, difference = search(kind, executable, seed, min(arguments.episode, arguments.requests - sent))
            sent += run.requests
            answers += run.answers
            undecided += run.undecided
            if difference is not None:
                failed = True
                print(f"{kind}, seed {seed}: {difference}", flush=True)
                steps = shrink(kind, executable, run.done, difference)
                run, difference = play(kind, executable, steps)
                print(f"shrunk to {len(steps)} steps: {difference}")
                print("\n".join(run.log), flush=True)
                if not arguments.keep_going:
                    break
            seed += 1
        broken_off = f", {undecided} episodes broken off" if undecided else ""
        print(f"{kind}: {sent} frames sent, {answers} of the device, from seed {first} on{broken_off}, "
              f"{time.monotonic() - begin:.1f} s", flush=True)  # fmt: skip
        if undecided * arguments.episode > UNDECIDED * sent + arguments.episode:
            failed = True
            print(f"{kind}: too many episodes were broken off")
        if answers < ANSWERS * sent:
            failed = True
            print(f"{kind}: the device was hardly heard")
    sys.exit(failed)


if __name__ == "__main__":
    main()
