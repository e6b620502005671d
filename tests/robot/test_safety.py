"""The safety layer: nothing gets around it, and what it lets through."""

import ast
import fcntl
import math
import os
import pty
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ndtorch.errors import InputError
from ndtorch.navigation import StereoRig
from ndtorch_robot.camera_monitor import CameraMonitor
from ndtorch_robot.faults import Fault, FaultKind
from ndtorch_robot.ports import DriveCommand, SafeCommand, StereoFrames, unseal
from ndtorch_robot.safety import SafeDrive, SafetyLimits
from tests.robot.support.cars import PlainDrive, SimulatedClock

ROBOT = Path(__file__).resolve().parents[2] / "robot" / "ndtorch_robot"
RIG = StereoRig(width=64, height=48, focal=43.0)
CRUISE = DriveCommand(0.5, 1.0)
LIMITS = SafetyLimits(0.6, 2.2, 2.0, 40.0, 0.1, 0.1, 1.0)


def test_only_the_safety_layer_makes_commands():
    with pytest.raises(TypeError, match=r"only robot\.safety"):
        SafeCommand(DriveCommand(0.5, 0.0), 0.0, object())
    for wrong in (DriveCommand(0.5, 0.0), (0.5, 0.0), None):
        with pytest.raises(TypeError, match="send through a SafeDrive"):
            unseal(wrong)
    drive, kept = PlainDrive(), []
    drive.send = lambda command: kept.append(command) or unseal(command)
    SafeDrive(drive, SimulatedClock()).send(DriveCommand(0.5, 0.0))
    with pytest.raises(AttributeError, match="cannot be changed"):
        kept[0].speed = 3.0


def test_nobody_else_has_the_seal():
    """The seal is used where it is defined and in the safety layer alone, and every drive asks for it."""
    users, drives = set(), 0
    for path in ROBOT.rglob("*.py"):
        tree = ast.parse(path.read_text())
        users |= {
            path.name for node in ast.walk(tree) if isinstance(node, ast.Name | ast.alias) and "_SEAL" in ast.dump(node)
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and node.name == "send" and "SafeCommand" in ast.dump(node.args):
                drives += path.name != "ports.py"
                assert path.name == "ports.py" or "unseal" in ast.dump(node), path
    assert users == {"ports.py", "safety.py"}
    assert drives == 4  # simulated, serial, MAVLink, and recorded, which moves nothing


@pytest.mark.parametrize("motion", [(math.nan, 0.0), (0.1, math.inf)])
def test_odometry_that_is_not_finite_stops_the_car_and_counts_as_none(motion):
    _, drive, lines, safe = make()
    drive.driven = lambda: DriveCommand(*motion)
    assert safe.driven() == DriveCommand(0.0, 0.0)
    assert safe.kind is FaultKind.DRIVE
    assert "not finite" in lines[0]
    assert safe.send(CRUISE).speed == 0.0
    drive.driven = lambda: CRUISE
    assert safe.driven() == CRUISE


def make(frame_check=False):
    clock, drive, lines = SimulatedClock(), PlainDrive(), []
    safe = SafeDrive(drive, clock, LIMITS, CameraMonitor(RIG, 30, 0.1) if frame_check else None, lines.append)
    return clock, drive, lines, safe


def steps(clock, safe, seconds, command=CRUISE, frames=None):
    for _ in range(round(seconds * 30)):
        clock.time += 1 / 30
        if frames is not None:
            safe.see(frames(), 0.5)
        safe.send(command)


def test_ramps_up_and_stops_at_once():
    clock, drive, _, safe = make()
    steps(clock, safe, 0.4)
    speeds = [sent.speed for sent in drive.sent]
    assert speeds[0] == 0.0
    assert speeds[1:8] == pytest.approx([min(0.5, n * 2.0 / 30) for n in range(1, 8)])
    steps(clock, safe, 1 / 30, DriveCommand(0.0, 0.0))
    assert drive.sent[-1].speed == 0.0
    steps(clock, safe, 0.4)
    steps(clock, safe, 1 / 30, DriveCommand(-0.5, 0.0))
    assert drive.sent[-1].speed == 0.0  # never straight through zero


def test_the_end_of_a_drive_does_not_pass():
    clock, drive, _, safe = make()
    steps(clock, safe, 0.5)
    safe.stop()
    assert (safe.auto_recover, safe.standing) == (False, "told to stop")
    steps(clock, safe, 3.0)
    assert drive.sent[-1] == (0.0, 0.0)


@settings(deadline=None)
@given(st.lists(st.tuples(st.floats(-0.6, 0.6), st.floats(-2.2, 2.2)), min_size=2, max_size=30))
def test_limits_hold_for_any_commands(commands):
    clock, drive, lines, safe = make()
    for command in commands:
        clock.time += 1 / 30
        safe.send(DriveCommand(*command))
    for a, b in zip(drive.sent, drive.sent[1:], strict=False):
        assert abs(b.speed) <= abs(a.speed) + 2.0 / 30 + 1e-9
        assert abs(b.curvature - a.curvature) <= 40.0 / 30 + 1e-9
    assert lines == []


@pytest.mark.parametrize("command", [DriveCommand(0.7, 0.0), DriveCommand(-0.7, 0.0), DriveCommand(0.5, 2.3)])
def test_out_of_limits_stands_and_goes_on(command):
    clock, drive, lines, safe = make()
    steps(clock, safe, 0.5)
    steps(clock, safe, 1 / 30, command)
    assert drive.stops == 1
    assert drive.sent[-1] == (0.0, 0.0)
    assert "out of limits" in lines[0]
    steps(clock, safe, 0.9)
    assert drive.sent[-1] == (0.0, 0.0)
    steps(clock, safe, 0.5)
    assert drive.sent[-1].speed > 0
    assert drive.resumes == 1


def test_a_fault_that_comes_again_starts_the_waiting_anew():
    clock, drive, lines, safe = make()
    steps(clock, safe, 0.5)
    for _ in range(3):
        steps(clock, safe, 1 / 30, DriveCommand(0.7, 0.0))
        steps(clock, safe, 0.8)
        assert drive.sent[-1] == (0.0, 0.0)
    assert (drive.resumes, len(lines)) == (0, 1)
    steps(clock, safe, 0.4)
    assert drive.sent[-1].speed > 0


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_what_is_no_number_ends_the_drive(value):
    clock, drive, _, safe = make()
    with pytest.raises(InputError, match="finite"):
        safe.send(DriveCommand(value, 0.0))
    assert drive.stops == 1
    steps(clock, safe, 3.0)
    assert set(drive.sent) == {(0.0, 0.0)}


def test_a_slow_step():
    clock, drive, lines, safe = make()
    steps(clock, safe, 0.5)
    clock.time += 0.2
    safe.send(DriveCommand(0.5, 0.0))
    assert drive.stops == 1
    assert "a step took 0.200 s" in lines[0]


def test_trouble_of_the_drive_and_emergency_need_resuming():
    for fault in ("link", "emergency"):
        clock, drive, lines, safe = make()
        steps(clock, safe, 0.5)
        if fault == "link":
            drive.why = "lost"
        else:
            safe.emergency("key")
        steps(clock, safe, 0.1)
        drive.why = None
        steps(clock, safe, 5.0)
        assert drive.sent[-1] == (0.0, 0.0)
        assert drive.resumes == 0
        safe.resume()
        steps(clock, safe, 0.5)
        assert drive.sent[-1].speed == 0.5
        assert lines[-1].startswith("resumed after")


def test_no_frames_no_driving():
    clock, drive, _, safe = make(frame_check=True)
    safe.resume()
    seed = [0]

    def good():
        seed[0] += 1
        made = torch.Generator().manual_seed(seed[0])
        left, right = torch.randint(20, 250, (2, 1, 3, 48, 16), generator=made, dtype=torch.uint8).repeat_interleave(
            4, -1
        )
        return StereoFrames(left, right, clock.time)

    steps(clock, safe, 0.5, frames=good)
    assert drive.sent[-1].speed == 0.5
    steps(clock, safe, 0.2)  # commands, but no frames
    assert drive.sent[-1] == (0.0, 0.0)
    assert "old" in safe.standing
    steps(clock, safe, 1.5, frames=good)
    assert drive.sent[-1].speed == 0.5


def test_unlimited_layer_changes_nothing():
    """In simulated time, where the car has limits of its own."""
    drive, clock = PlainDrive(), SimulatedClock()
    safe = SafeDrive(drive, clock)
    wanted = [DriveCommand(s, c) for s, c in ((0.5, 2.0), (-9.0, -50.0), (9.0, 50.0), (0.0, 1.0))]
    for command in wanted:
        safe.send(command)
        clock.time += 10.0
    assert drive.sent == wanted
    assert drive.stops == 0


@pytest.mark.parametrize("kind", FaultKind)
def test_whether_a_fault_passes_hangs_on_its_kind_and_not_on_its_words(kind):
    """The same words for all of them."""
    clock, drive, _, safe = make(frame_check=True)
    said = iter([Fault(kind, "the cameras are swapped, and show nothing but the same image"), *[None] * 100])
    safe.frame_check.judge = lambda *_: next(said)
    eye = torch.zeros(1, 3, 48, 64)
    steps(clock, safe, 2.0, frames=lambda: StereoFrames(eye, eye, clock.time))
    assert safe.faults[0].kind is kind
    assert (safe.standing is None) == kind.auto_recover
    assert (safe.kind is None) == kind.auto_recover
    assert any(command.speed for command in drive.sent) == kind.auto_recover


def test_kinds_are_told_apart():
    assert len({kind.words for kind in FaultKind}) == len(FaultKind)
    assert {kind for kind in FaultKind if not kind.auto_recover} == {
        FaultKind.FROZEN,
        FaultKind.COMMAND,
        FaultKind.DRIVE,
        FaultKind.NOT_STARTED,
        FaultKind.EMERGENCY,
    }


def test_a_limit_in_single_precision_is_no_fault():
    clock, drive = SimulatedClock(), PlainDrive()
    safe = SafeDrive(drive, clock, SafetyLimits(0.4, 2.2))
    for _ in range(30):
        clock.wait_until(clock.now() + 1 / 30)
        sent = safe.send(DriveCommand(float(torch.tensor(0.4)), float(torch.tensor(-2.2))))
    assert float(torch.tensor(0.4)) > 0.4
    assert safe.faults == []
    assert sent == DriveCommand(0.4, -2.2)


PROGRAM = """
import termios, time
from ndtorch_robot.emergency import emergency_stops
from ndtorch_robot.loop import MonotonicClock
from ndtorch_robot.ports import DriveCommand
from ndtorch_robot.safety import SafeDrive
from tests.robot.support.cars import PlainDrive

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
