"""Cameras that fail are noticed, and the car is stopped."""

import pytest
import torch

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch.navigation import StereoRig
from ndtorch_robot.camera_monitor.limits import CameraLimits
from ndtorch_robot.camera_monitor.monitor import EVERY, PATIENCE, CameraMonitor
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.drive import drive
from ndtorch_robot.ports import DriveCommand, StereoFrames
from ndtorch_robot.sim.simulation import Simulation

RIG = StereoRig(width=64, height=48, focal=43.0)


def picture(n, dtype=torch.uint8):
    # Things are wider than a pixel; what is not counts as noise.
    seed = torch.Generator().manual_seed(n)
    frame = torch.randint(20, 250, (1, 3, 48, 16), generator=seed, dtype=torch.uint8).repeat_interleave(4, -1)
    return frame if dtype == torch.uint8 else frame.to(dtype) / 255


def see(change, speed=0.5, count=2 * PATIENCE, dtype=torch.uint8, limits=None):
    monitor = CameraMonitor(RIG, limits=limits)
    for n in range(count):
        frames = StereoFrames(picture(2 * n, dtype), picture(2 * n + 1, dtype), n / 30)
        monitor.check(change(n, frames), speed)
    return monitor


@pytest.mark.parametrize("dtype", [torch.uint8, torch.float32])
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda n, f: f._replace(right=f.right * 0), "right camera (has seen nothing but black for 15|shows nothing)"),
        (lambda n, f: f._replace(left=picture(1, f.left.dtype)), "left camera (has given|shows) the same image"),
        (lambda n, f: f._replace(left=None) if n == 3 else f, "left camera gave no frame"),
        (lambda n, f: f._replace(time=0.05) if n == 3 else f, "must increase, got 0.050 s after 0.067 s"),
        (lambda n, f: f._replace(time=float("nan")), "must increase"),
        (lambda n, f: f._replace(right=f.right[:, :1]), "alike"),
        (lambda n, f: f._replace(right=f.right.double()), "alike"),
        (lambda n, f: f._replace(right=f.right[..., :40, :]), "gives 64x40 frames, 64x48 are wanted"),
    ],
)
def test_bad_frames(change, message, dtype):
    with pytest.raises(InputError, match=message) as error:
        see(change, dtype=dtype)
    assert "\n" not in str(error.value)


def spoilt(k, how):
    """The left camera (0) or the right one (1), whose pictures are like that."""
    return lambda n, f: f._replace(**{("left", "right")[k]: how(f[k])})


@pytest.mark.parametrize("k", [0, 1])
@pytest.mark.parametrize(
    ("how", "at", "message"),
    [
        (lambda eye: eye * 0, PATIENCE, "has seen nothing but black"),
        (lambda eye: picture(1), PATIENCE + 1, "has given the same image"),
        (lambda eye: torch.full_like(eye, 99), EVERY * round(0.5 * 30 / EVERY), "shows nothing"),
    ],
)
def test_either_camera_is_believed_for_as_long(k, how, at, message):
    """To the very picture: from the first one that looks wrong."""
    limits = CameraLimits(patience_s=0.5, moved_m=9.0)
    see(spoilt(k, how), count=at - 1, limits=limits)
    with pytest.raises(InputError, match=message):
        see(spoilt(k, how), count=at, limits=limits)


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["frozen", "nan"])
def test_the_car_is_stopped_first(monkeypatch, fault):
    read, kept, worlds = Simulation.read, [], []

    def faulty(self):
        frames = read(self)
        kept.append(frames)
        worlds.append(self)
        if len(kept) <= 20:
            return frames
        if fault == "frozen":
            return frames._replace(right=kept[0].right)
        left, right = frames.left / 255, frames.right / 255
        left[0, 0, 240, 5] = torch.nan
        return frames._replace(left=left, right=right)

    monkeypatch.setattr(Simulation, "read", faulty)
    with pytest.raises(InputError, match="same image" if fault == "frozen" else "finite"):
        drive(DriveConfig(controller="published", full_frames=True))
    assert len(kept) in (21, 25)
    assert worlds[0].car.speed == 0.0


@pytest.mark.slow
def test_a_blank_building_is_no_fault():
    summary = drive(DriveConfig(arena="loop", walls="blank", seconds=3)).summary
    assert summary["simulated_seconds"] == 3.0
    assert summary["distance_m"] > 1.0
    assert summary["faults"] == []


@pytest.mark.parametrize(
    ("change", "message"),
    [(lambda f: f._replace(left=None), "left camera gave no frame"), (lambda f: f._replace(time=0.1), "s old")],
)
def test_the_command_ends_with_one_line(monkeypatch, capsys, tmp_path, change, message):
    """Whatever the cameras do, the car stands still before the program ends."""
    read, cars = Simulation.read, []

    def faulty(self):
        cars.append(self.car)
        frames = read(self)
        return frames if len(cars) <= 10 else change(frames)

    monkeypatch.setattr(Simulation, "read", faulty)
    assert main(["drive", "--full-frames", "--json", "--out", str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    line = err.splitlines()[-1]  # before it a first start may say that it compiles
    assert line.startswith("error: ")
    assert message in line
    assert cars[-1].speed == 0.0
    assert cars[-1].wanted == DriveCommand(0.0, 0.0)
