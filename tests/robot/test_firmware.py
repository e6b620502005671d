"""The firmware: its own tests on this computer, its size, its messages against Python's, and the simulated binary."""

import re
import subprocess
import time

import numpy as np
import pytest

from ndtorch.commands import main
from ndtorch_robot.link.messages import BODY_SIZE, VERSION, Fault, Type
from ndtorch_robot.run import real_time_priority
from tests.robot.bench import bench, ordinary_priority
from tests.robot.board_needed import FIRMWARE, needs_board, needs_board_and_gl


def test_own_tests_and_a_short_fuzzing():
    done = subprocess.run(["make", "-s", "-C", FIRMWARE, "test"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "checks passed" in done.stdout
    assert "0 accepted that were not sent" in done.stdout


def test_both_sides_mean_the_same():
    text = (FIRMWARE / "protocol.h").read_text() + (FIRMWARE / "drive.h").read_text()
    assert int(re.search(r"PROTOCOL_VERSION (\d+)", text)[1]) == VERSION
    assert {k: int(v, 0) for k, v in re.findall(r"(\w+) = (\w+)", re.search(r"enum message \{(.*?)\}", text)[1])} == {
        kind.name: kind.value for kind in Type
    }
    assert {k: int(v) for k, v in re.findall(r"FAULT_(\w+) = (\d+)", text)} == {f.name: f.value for f in Fault}
    assert max(BODY_SIZE.values()) <= int(re.search(r"MAX_BODY (\d+)", text)[1])


@needs_board
def test_fits_the_board():
    subprocess.run(["make", "-s", "-C", FIRMWARE, "all"], check=True)
    size = subprocess.run(["avr-size", FIRMWARE / "build" / "firmware.elf"], capture_output=True, text=True, check=True)
    code, data, zeroed = (int(n) for n in size.stdout.splitlines()[1].split()[:3])
    assert code + data < 32256  # 32 kB less the boot loader
    assert data + zeroed < 1024  # half of the memory, the rest is the stack's
    assert (FIRMWARE / "build" / "firmware.hex").stat().st_size > 1000


@pytest.mark.realtime
@needs_board
def test_bring_up(capsys, tmp_path):
    config = tmp_path / "car.toml"
    config.write_text('robot = "maxston8"\n[simulation]\n')
    real_time_priority(print)
    try:
        assert main(["check", str(config), "--yes"]) == 0, capsys.readouterr()
    finally:
        ordinary_priority()
    said = capsys.readouterr().out
    assert "the board says it stands" in said
    assert "all well" in said


@needs_board
def test_another_robots_configuration(capsys, tmp_path):
    config = tmp_path / "car.toml"
    config.write_text('robot = "lorry"\n[simulation]\n')
    assert main(["check", str(config), "--yes"]) == 2
    assert "the board is that of the robot 'maxston8', the configuration is for 'lorry'" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.realtime
@needs_board_and_gl
def test_closes_the_loop_without_hardware():
    """Twenty seconds in the curve; times are asserted only where the computer could keep them."""
    with bench() as car:
        for _ in range(200):
            if car.car.loop.steps > 600:
                break
            time.sleep(0.1)
        summary, cameras = car.car.summary(), car.cameras.inner
        assert summary["steps"] > 500
        assert cameras.distance > 5.0
        assert cameras.simulation.collisions == []
        print(summary["round_trip_ms"], summary["jitter_ms"], summary["parts_ms"])
        assert summary["jitter_ms"]["p50"] < 5.0
        assert np.median(car.car.drive.round_trips()) < 0.01
