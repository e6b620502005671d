"""Links by name: another one is a class, a table and a function."""

import cv2
import numpy as np
import pytest

from ndtorch.errors import InputError
from ndtorch.utils.toml import Strict, read_toml
from ndtorch_robot.link import Opening, link, open_link
from ndtorch_robot.link.registry import KINDS
from ndtorch_robot.ports import STAND, Drive, unseal
from ndtorch_robot.run import open_car
from ndtorch_robot.run_config import RunConfig


class PaperSettings(Strict):
    pages: int = 3


class PaperDrive(Drive):
    """Writes down what it is told, and knows nothing else."""

    def __init__(self, pages, robot):
        self.pages, self.robot, self.written, self.closed = pages, robot, [STAND], 0

    def send(self, command):
        self.written.append(unseal(command))
        return self.written[-1]

    def stop(self):
        self.written.append(STAND)

    def resume(self):
        return True

    def driven(self):
        return self.written[-1]

    def close(self):
        self.stop()
        self.closed += 1


@pytest.fixture
def paper():
    """A kind of link that only this file knows."""
    made = []

    @link("paper", PaperSettings)
    def open_paper(settings, opening):
        made.append(PaperDrive(settings.pages, opening.robot))
        return made[-1]

    yield made
    del KINDS["paper"]


def folders(where, count=45):
    """Two folders of pictures that slide past."""
    wall = np.random.default_rng(1).integers(0, 256, (48, 64 + 3 * count, 3), dtype=np.uint8)
    for name, shift in (("left", 0), ("right", 5)):
        (where / name).mkdir()
        for n in range(count):
            part = wall[:, shift + 2 * n :][:, :64]
            cv2.imwrite(str(where / name / f"{n:04d}.png"), part)


@pytest.mark.realtime
def test_a_car_on_another_link(tmp_path, paper):
    folders(tmp_path)
    (tmp_path / "car.toml").write_text(
        f"""
robot = "paper"
[link]
kind = "paper"
pages = 7
[cameras]
left = "{tmp_path / "left"}"
right = "{tmp_path / "right"}"
width_px = 64
height_px = 48
[rig]
width_px = 64
height_px = 48
focal_px = 43.0
[navigation]
controller = "published"
[limits]
frame_age_s = 0.2
"""
    )
    config, steps = read_toml(tmp_path / "car.toml", RunConfig), []
    with open_car(config, lambda line: None, True, [steps.append]) as car:
        car.observers.append(lambda step: car.ended.set() if step.frames is None else None)  # the film is over
        car.run(5.0)
    (drive,) = paper
    assert (drive.pages, drive.robot) == (7, "paper")
    assert drive.closed
    assert drive.written[-1] == STAND
    assert sum(step.used for step in steps) > 10
    assert max(command.speed for command in drive.written) > 0.0
    assert {step.sent for step in steps} <= set(drive.written)
    assert car.summary()["round_trip_ms"] == {}


def test_the_simulated_world_is_a_link(tmp_path):
    (tmp_path / "car.toml").write_text(
        'robot = "sim"\n[link]\nkind = "simulated-world"\n[simulation]\narena = "curve"\nseed = 11\n'
    )
    steps = []
    with open_car(read_toml(tmp_path / "car.toml", RunConfig), lambda line: None, True, [steps.append]) as car:
        assert car.run(2.0) == 61
        assert car.cameras is car.drive
        assert car.drive.car.x != steps[0].driven.speed
    assert steps[-1].sent.speed == pytest.approx(0.5)
    assert car.drive.car.speed == 0.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[link]\nkind = "can"', "no link of the kind 'can', known are .*hosted-board, .*serial, simulated-world"),
        ('[link]\nkind = "simulated-board"', "'simulated-board' is gone: use 'hosted-board'"),
        ('[link]\nkind = "serial"\nbaud = 500', "device"),
        ('[link]\ndevice = "/dev/x"\nbaud = 5', "baud = 5: should be greater"),
        ('[link]\ndevice = "/dev/x"\nbauds = 9600', "unknown key 'bauds'; did you mean baud?"),
        ('[link]\nkind = "paper"\npages = "many"', "pages = 'many'"),
        ("", "real cameras need a real board: give link.device"),
    ],
)
def test_bad_tables(tmp_path, paper, text, message):
    (tmp_path / "car.toml").write_text(f'robot = "x"\n{text}\n[cameras]\nleft = "0"\nright = "1"\n')
    with pytest.raises(InputError, match=message) as error:
        read_toml(tmp_path / "car.toml", RunConfig)
    assert "\n" not in str(error.value)


def test_a_simulated_world_needs_a_link_that_moves_it(paper):
    with pytest.raises(InputError, match=r"a simulated world is driven by link\.kind = 'hosted-board'"):
        open_link({"kind": "paper"}, Opening("x", print, object()))
    assert paper[0].closed == 1
    with pytest.raises(InputError, match=r"needs the table \[simulation\]"):
        open_link({"kind": "simulated-world"}, Opening("x", print))
