"""The firmware: its own tests on this computer, its size, its messages against Python's, and the simulated binary."""

import os
import re
import select
import subprocess
import time

import numpy as np
import pytest

from ndtorch_robot.link.messages import (
    BODY_SIZE,
    VERSION,
    LinkFault,
    LinkFrame,
    Parser,
    Type,
    command_body,
    encode_frame,
    read_telemetry,
)
from ndtorch_robot.ports import DriveCommand
from tests.robot.support.avr_board import AvrBoard
from tests.robot.support.bench import bench
from tests.robot.support.board_needed import FIRMWARE, needs_board


def make(*targets):
    return subprocess.run(["make", "-s", "-C", FIRMWARE, *targets], capture_output=True, text=True, check=False)


def test_own_tests_and_a_short_fuzzing():
    done = make("test")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "checks passed" in done.stdout
    assert "0 accepted that were not sent" in done.stdout


@needs_board
def test_own_tests_on_a_board():
    """An int of the board has 16 bits: sums that are right on this computer may be wrong there."""
    done = make("test-board", "BOARD_INPUTS=300")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "checks passed, int has 16 bits" in done.stdout
    assert "30 drives" in done.stdout
    assert "0 accepted that were not sent" in done.stdout


def test_both_sides_mean_the_same():
    text = (FIRMWARE / "protocol.h").read_text() + (FIRMWARE / "drive.h").read_text()
    assert int(re.search(r"PROTOCOL_VERSION (\d+)", text)[1]) == VERSION
    assert {k: int(v, 0) for k, v in re.findall(r"(\w+) = (\w+)", re.search(r"enum message \{(.*?)\}", text)[1])} == {
        kind.name: kind.value for kind in Type
    }
    assert {k: int(v) for k, v in re.findall(r"FAULT_(\w+) = (\d+)", text)} == {f.name: f.value for f in LinkFault}
    assert max(BODY_SIZE.values()) <= int(re.search(r"MAX_BODY (\d+)", text)[1])


@needs_board
def test_fits_the_board():
    assert make("all").returncode == 0
    size = subprocess.run(["avr-size", FIRMWARE / "build" / "firmware.elf"], capture_output=True, text=True, check=True)
    code, data, zeroed = (int(n) for n in size.stdout.splitlines()[1].split()[:3])
    assert code + data < 32256  # 32 kB less the boot loader
    assert data + zeroed < 1024  # half of the memory, the rest is the stack's
    assert (FIRMWARE / "build" / "firmware.hex").stat().st_size > 1000


@pytest.fixture
def line():
    """A simulated board and its serial port."""
    board = AvrBoard()
    port = os.open(board.device, os.O_RDWR | os.O_NOCTTY)
    try:
        yield board, port
    finally:
        os.close(port)
        board.close()


def talk(port, *frames):
    """Send frames of these types and bodies."""
    os.write(port, b"".join(encode_frame(LinkFrame(VERSION, kind, number, body)) for number, kind, body in frames))


def telemetry(port, parser):
    """All that has come since."""
    frames = parser.feed(os.read(port, 4096)) if select.select([port], [], [], 0.0)[0] else []
    return [read_telemetry(frame.body) for frame in frames if frame.type == Type.TELEMETRY]


def between(board, since, name):
    return [pulse.width for pulse in board.pulses[since:] if pulse.name == name]


def flood(port, bursts, each=40):
    """Bursts of valid frames as fast as the line takes them, each sent when the board has answered the one before (or
    has refused its heartbeat, which it cannot say); afterwards heartbeats until one is answered.

    Returns all telemetry.
    """
    parser, heard, last = Parser(), [], 3 + bursts * each
    body = command_body(DriveCommand(0.5, 1.0))

    def answered(number, seconds):
        end = time.monotonic() + seconds
        while not heard or heard[-1].echo != number:
            if time.monotonic() > end:
                return False
            heard.extend(telemetry(port, parser))
            time.sleep(0.0005)
        return True

    for number in range(3, last, each):
        talk(port, (number, Type.HEARTBEAT, b""), *((number + k, Type.COMMAND, body) for k in range(1, each)))
        answered(number, 0.2)
    for number in range(last, last + 100):
        talk(port, (number, Type.HEARTBEAT, b""))
        if answered(number, 0.1):
            return heard
    raise AssertionError("the board answers no more")


@needs_board
def test_a_flood_of_valid_commands_starves_nothing(line):
    """Every pulse stays a good one, and the board goes on telling: its watchdog timer never has to bite.

    What it cannot read in time it refuses, and stands for that. Judged by the processor's cycles."""
    board, port = line
    talk(port, (1, Type.HELLO, b""), (2, Type.ARM, b""))
    heard = flood(port, bursts=60)
    assert not any(LinkFault.WATCHDOG in told.faults for told in heard)
    assert heard[-1].uptime_s >= heard[0].uptime_s
    rear = between(board, 0, "rear")
    assert len(rear) > 10
    assert all(abs(width - 1300) < 15 or abs(width - 1500) < 15 for width in rear), rear


@pytest.mark.realtime  # it has to be told to drive all the time
@needs_board
def test_a_main_loop_that_hangs_shortens_no_pulse(line):
    """Until the watchdog timer bites, the rear wheels stay where they were; then they are straight."""
    board, port = line
    talk(port, (1, Type.HELLO, b""))
    bent = command_body(DriveCommand(0.3, 2))
    parser, armed = Parser(), 0
    for n in range(100):
        # The board may still be starting when it is first told.
        more = [] if armed else [(3 * n + 2, Type.ARM, b"")]
        talk(port, *more, (3 * n + 3, Type.HEARTBEAT, b""), (3 * n + 4, Type.COMMAND, bent))
        time.sleep(0.03)
        armed += any(told.armed for told in telemetry(port, parser))
        if armed > 5:
            break
    assert between(board, -10, "rear")[-1] == pytest.approx(1100, abs=15)
    before = len(board.pulses)
    board.command("hang")
    time.sleep(0.4)
    widths = between(board, before, "rear")
    assert len(widths) > 5
    odd = [width for width in widths if abs(width - 1100) > 15 and abs(width - 1500) > 15]
    assert len(odd) <= 1, widths  # the reset may fall into a pulse and end it
    assert widths[-1] == pytest.approx(1500, abs=15)


@pytest.mark.slow
@pytest.mark.realtime
@needs_board
def test_closes_the_loop_without_hardware():
    """Eight seconds in the curve."""
    with bench() as car:
        for _ in range(80):
            if car.car.steps > 240:
                break
            time.sleep(0.1)
        summary, cameras = car.car.summary(), car.cameras.inner
        assert summary["steps"] > 200
        assert cameras.distance > 2.0
        assert cameras.simulation.collisions == []
        print(summary["round_trip_ms"], summary["jitter_ms"], summary["parts_ms"])
        assert summary["jitter_ms"]["p50"] < 5.0
        assert np.median(car.car.drive.round_trips()) < 0.01
