"""Links by name: another one is a class, a table and a function."""

import struct

import cv2
import numpy as np
import pytest

from ndtorch.errors import InputError
from ndtorch.utils.toml import Strict, read_toml
from ndtorch_robot.link import Opening, link, open_link
from ndtorch_robot.link.link_drive import LinkDrive
from ndtorch_robot.link.messages import Fault, Frame, Type
from ndtorch_robot.link.registry import LINKS
from ndtorch_robot.ports import _SEAL, STAND, Drive, DriveCommand, SafeCommand, unseal
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
        made.append(PaperDrive(settings.pages, opening.board_name))
        return made[-1]

    yield made
    del LINKS["paper"]


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
board_name = "paper"
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
        'board_name = "sim"\n[link]\nkind = "simulated-world"\n[simulation]\narena = "curve"\nseed = 11\n'
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
        ('[link]\nkind = "serial"\nbaud = 500', "device"),
        ('[link]\ndevice = "/dev/x"\nbaud = 5', "baud = 5: should be greater"),
        ('[link]\ndevice = "/dev/x"\nbauds = 9600', "unknown key 'bauds'; did you mean baud?"),
        ('[link]\nkind = "paper"\npages = "many"', "pages = 'many'"),
        ("", "real cameras need a real board: give link.device"),
    ],
)
def test_bad_tables(tmp_path, paper, text, message):
    (tmp_path / "car.toml").write_text(f'board_name = "x"\n{text}\n[cameras]\nleft = "0"\nright = "1"\n')
    with pytest.raises(InputError, match=message) as error:
        read_toml(tmp_path / "car.toml", RunConfig)
    assert "\n" not in str(error.value)


def test_a_simulated_world_needs_a_link_that_moves_it(paper):
    with pytest.raises(InputError, match=r"a simulated world is driven by link\.kind = 'hosted-board'"):
        open_link({"kind": "paper"}, Opening("x", print, object()))
    assert paper[0].closed == 1
    with pytest.raises(InputError, match=r"needs the table \[simulation\]"):
        open_link({"kind": "simulated-world"}, Opening("x", print))


class Heard:
    """A line that keeps what is written to it."""

    def __init__(self):
        self.kinds, self.echoes, self.takes = [], [], True

    def write(self, kind, body=b""):
        self.kinds.append(kind)
        return self.takes

    def echoed(self, echo, now):
        self.echoes.append((echo, now))

    def said(self):
        kinds, self.kinds = self.kinds, []
        return kinds


class Known:
    """A drive whose board has answered at 10 s, with a clock that is set by hand."""

    def __init__(self, armed=True):
        self.time, self.line, self.lines, self.sequence = 10.0, Heard(), [], 0
        self.drive = LinkDrive(self.line, lambda: self.time, report=self.lines.append)
        self.drive.on_welcome(Frame(1, Type.WELCOME, 0, struct.pack("<H8s", 1, b"maxston8")))
        if armed:
            assert self.drive.resume()
            self.tell()
        self.line.said()

    def tell(self, armed=True, faults=0, echo=7):
        self.sequence += 1
        body = struct.pack("<HBBhhHHHHHH", echo, armed, int(faults), 500, 100, 7400, 1500, 1500, 1500, 0, 3)
        self.drive.on_telemetry(Frame(1, Type.TELEMETRY, self.sequence, body))

    def send(self, made):
        return self.drive.send(SafeCommand(DriveCommand(0.5, 0.1), made, _SEAL))


def test_a_loop_is_dead_after_a_patience_and_not_before():
    car = Known()
    car.send(10.0)
    car.time = 10.119
    car.tell()
    car.line.said()
    car.drive.look_after()
    assert (car.line.said(), car.drive.trouble()) == ([Type.HEARTBEAT], None)
    car.time = 10.121
    car.drive.look_after()
    assert car.line.said() == [Type.STOP, Type.HEARTBEAT]
    assert car.drive.trouble() == "the loop has sent nothing for 0.12 s"
    assert car.lines[-1] == "link: the loop has sent nothing for 0.12 s"
    # A car that stands by itself need not be told anything by its loop.
    car.time = 10.2
    car.tell(armed=False)
    car.drive.look_after()
    assert (car.line.said(), len(car.lines)) == ([Type.HEARTBEAT], 1)


def test_a_link_is_lost_after_a_patience_and_not_before():
    car = Known()
    car.time = 10.119
    car.send(10.119)
    car.drive.look_after()
    assert car.line.said() == [Type.COMMAND, Type.HEARTBEAT]
    car.time = 10.121
    car.send(10.121)
    car.line.said()
    car.drive.look_after()
    assert car.line.said() == [Type.STOP]
    assert car.drive.trouble() == "lost: no valid telemetry for 0.12 s"
    assert not car.drive.resume()
    car.drive.look_after()  # nobody there to be spoken to
    assert car.line.said() == []
    for at, said in ((10.13, [Type.HELLO]), (10.229, []), (10.2301, [Type.HELLO])):
        car.time = at
        car.drive.greet()
        assert car.line.said() == said
    car.drive.on_welcome(Frame(1, Type.WELCOME, 0, struct.pack("<H8s", 1, b"maxston8")))
    assert car.lines[-1] == "link: connected again; the car stands until it is told to resume"
    car.drive.greet()
    assert car.line.said() == []


def test_what_was_applied_before_a_link_was_lost_is_not_driven_after_it():
    """Who took it for driven would say that pictures stand still that must move."""
    car = Known()
    car.tell()
    assert car.drive.driven() == car.drive.driven() == DriveCommand(0.5, 0.1)  # the second time it is the latest
    car.time += 1.0
    car.drive.look_after()
    assert car.drive.driven() == STAND
    car.drive.on_welcome(Frame(1, Type.WELCOME, car.sequence, struct.pack("<H8s", 1, b"maxston8")))
    assert car.drive.driven() == STAND
    car.tell()
    assert car.drive.driven() == car.drive.driven() == DriveCommand(0.5, 0.1)


def test_an_old_command_is_not_sent_and_one_that_is_not_taken_moves_nothing():
    car = Known()
    car.time = 10.099
    assert car.send(10.0) == DriveCommand(0.5, 0.1)
    car.time = 10.101
    assert car.send(10.0) == STAND
    assert car.line.said() == [Type.COMMAND]
    car.line.takes = False
    assert car.send(10.1) == STAND
    assert Known(armed=False).send(10.0) == STAND


def test_a_board_that_stands_is_believed_once_it_must_know_that_it_may_drive():
    car = Known(armed=False)
    assert car.drive.trouble() == "not yet told to drive"
    assert car.drive.resume()
    assert car.line.said() == [Type.ARM]
    car.time = 10.099
    car.tell(armed=False)
    assert car.drive.trouble() is None
    car.time = 10.101
    car.tell(armed=False)
    assert car.drive.trouble() == "the board does not resume"
    assert car.line.said() == [Type.STOP]
    car = Known()
    car.time = 10.2
    car.tell(armed=False, faults=Fault.NOISE)
    assert car.drive.trouble() == "the board has stopped: too many refused frames"
    assert car.line.said() == []
    assert car.line.echoes == [(7, 10.0), (7, 10.2)]


def test_a_drive_that_was_stopped_says_so_to_the_board_and_no_more():
    car = Known()
    car.drive.stop()
    assert car.line.said() == [Type.STOP]
    assert car.send(10.0) == STAND
    car.tell(armed=False)
    assert (car.drive.trouble(), car.lines) == (None, [])


def test_many_refused_frames_from_the_board_stop_it_once():
    car = Known()
    car.drive.receiver.parser.refused += 3
    car.drive.handle(b"")
    assert car.drive.trouble() is None
    car.drive.receiver.parser.refused += 2
    car.drive.handle(b"")
    car.drive.handle(b"")
    assert car.drive.trouble() == "bad line: many frames from the board are refused"
    assert (car.line.said(), len(car.lines)) == ([Type.STOP], 1)
    assert car.drive.resume()
    car.drive.handle(b"")
    assert car.drive.trouble() is None
