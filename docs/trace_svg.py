#!/usr/bin/env python3
"""Draws docs/trace.svg for docs/guides/bench.md from a real run: pve-sim in a terminal, and examples/drive.py as the master.

    cargo build && target/venv/bin/pip install rich && target/venv/bin/python docs/trace_svg.py target/debug/pve-sim
"""
import fcntl
import os
import pty
import struct
import subprocess
import sys
import termios
from pathlib import Path

from rich.console import Console
from rich.text import Text

COLUMNS, LINES = 120, 40
ROOT = Path(__file__).resolve().parent.parent


def until(fd, end, text=b""):
    """Reads until the text has `end` in it."""
    while end not in text:
        text += os.read(fd, 4096)
    return text


def main(pve_sim):
    terminal, inside = pty.openpty()
    fcntl.ioctl(inside, termios.TIOCSWINSZ, struct.pack("HHHH", LINES, COLUMNS, 0, 0))
    environment = {**os.environ, "TERM": "xterm-256color"}
    simulator = subprocess.Popen([pve_sim], stdin=inside, stdout=inside, stderr=inside, env=environment)
    text = until(terminal, b"EMCY: no error")
    master = subprocess.Popen(
        [sys.executable, "-u", str(ROOT / "examples/drive.py")], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    until(master.stdout.fileno(), b"spool 8192")
    text = until(terminal, b"+50.0 %", text)
    master.communicate(b"\n")
    text = until(terminal, b"time guarding", text)
    text = until(terminal, b"\n", text)
    simulator.terminate()
    simulator.wait()

    lines = text.decode().replace("\r\n", "\n").splitlines()
    shown = ["$ cargo run"] + [line for line in lines if line.strip()]
    console = Console(record=True, width=COLUMNS, file=open(os.devnull, "w"), color_system="truecolor", legacy_windows=False)
    for line in shown:
        console.print(Text.from_ansi(line), soft_wrap=False)
    console.save_svg(str(ROOT / "docs/trace.svg"), title="pve-sim")


main(sys.argv[1])
