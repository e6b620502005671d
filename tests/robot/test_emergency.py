"""The emergency stop by key, through a real terminal: a pty whose other end is typed on."""

import fcntl
import os
import pty
import subprocess
import sys
import termios
import time

import pytest

PROGRAM = """
import termios, time
from ndtorch_robot.emergency import emergency_stops
from ndtorch_robot.loop import MonotonicClock
from ndtorch_robot.ports import DriveCommand
from ndtorch_robot.safety import SafeDrive
from tests.robot.support.plain_drive import PlainDrive

drive = PlainDrive()
safe = SafeDrive(drive, MonotonicClock(), report=lambda line: print(f"{time.monotonic():.4f} {line}", flush=True))
with emergency_stops(safe) as ended:
    safe.send(DriveCommand(0.5, 0.0))
    print("ready", flush=True)
    while not ended.is_set():
        safe.send(DriveCommand(0.5, 0.0))
        end = time.monotonic() + 0.5  # a step that takes long: no key is waited for in it
        while time.monotonic() < end:
            pass
modes = termios.tcgetattr(0)[3]
print("echoes" if modes & termios.ECHO and modes & termios.ICANON else "raw", drive.stops, drive.sent[0].speed)
"""


@pytest.fixture
def terminal():
    """The program in a terminal of its own, and what it is typed on."""
    master, slave = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM],
        stdin=slave,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
    )
    os.close(slave)
    yield master, process
    process.kill()
    process.wait()
    process.stdout.close()
    os.close(master)


@pytest.mark.realtime
def test_keys(terminal):
    """Any key stops, in the middle of a step; g goes on; Ctrl-C stops and ends, and the terminal is as it was."""
    master, process = terminal
    assert process.stdout.readline() == "ready\n"
    for key in (" ", "x", "\n", "\x1b"):
        pressed = time.monotonic()
        os.write(master, key.encode())
        when, said = process.stdout.readline().strip().split(" ", 1)
        assert said == f"stopped: emergency stop: key {key!r}"
        assert float(when) - pressed < 0.25
        os.write(master, b"g")
        assert process.stdout.readline().strip().endswith(f"resumed after: emergency stop: key {key!r}")
    os.write(master, b"\x03")
    assert process.stdout.readline().strip().endswith("stopped: emergency stop: SIGINT")
    echoes, stops, speed = process.stdout.readline().split()
    assert echoes == "echoes"
    assert int(stops) >= 5
    assert float(speed) == 0.5
    assert process.wait(5) == 0
