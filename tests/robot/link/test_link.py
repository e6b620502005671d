"""The drive link: frames, the protocol with the board, errors on opening, a line that is lost, links by name."""

import os
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ndtorch.errors import InputError
from ndtorch.utils.toml import Strict, read_toml
from ndtorch_robot.link import LINKS, Opening, link, open_link, serial_drive
from ndtorch_robot.link.link_drive import LinkDrive
from ndtorch_robot.link.messages import (
    BODY_SIZE,
    LinkFault,
    LinkFrame,
    Parser,
    Type,
    command_body,
    encode_frame,
    read_telemetry,
)
from ndtorch_robot.link.serial_drive import SerialDrive
from ndtorch_robot.ports import _SEAL, STAND, Drive, DriveCommand, SafeCommand, unseal
from ndtorch_robot.run import open_car
from ndtorch_robot.run_config import RunConfig
from tests.robot.support.fake_captures import LiveCapture
from tests.robot.support.peer import Peer, board

# Frames.

FRAMES = st.sampled_from(list(Type)).flatmap(
    lambda kind: st.builds(
        LinkFrame,
        st.just(1),
        st.just(int(kind)),
        st.integers(0, 65535),
        st.binary(min_size=BODY_SIZE[kind], max_size=BODY_SIZE[kind]),
    )
)


def test_frames_as_they_go_over_the_line():
    assert encode_frame(LinkFrame(1, Type.HELLO, 0)).hex() == "030101010544c5af2400"
    command = LinkFrame(1, Type.COMMAND, 65535, command_body(DriveCommand(0.5, -2.0)))
    assert encode_frame(command).hex() == "0d0103fffff40130f871a9d1f300"
    assert command_body(DriveCommand(0.5, -2.0)) == bytes([0xF4, 0x01, 0x30, 0xF8])
    assert command_body(DriveCommand(-1.0, 0.001)) == struct.pack("<hh", -1000, 1)
    body = bytes([5, 0, 1, 16, 0xF4, 1, 0x18, 0xFC, 0xE8, 0x1C, 0x5E, 6, 0xDC, 5, 0xDC, 5, 3, 0, 60, 0])
    t = read_telemetry(body)
    assert (t.echo, t.armed, t.applied, t.battery_v, t.motor_us, t.rejected, t.uptime_s) == (
        *(5, True, (0.5, -1.0), 7.4),
        *(1630, 3, 60),
    )
    assert t.words() == ["battery low"]


@given(st.lists(FRAMES, max_size=6), st.lists(st.integers(1, 9), min_size=1, max_size=9))
def test_any_pieces_give_the_same_frames(frames, sizes):
    stream, parser, got, at = b"".join(map(encode_frame, frames)), Parser(), [], 0
    for n in range(len(stream)):
        size = sizes[n % len(sizes)]
        got += parser.feed(stream[at : at + size])
        at += size
    assert got == frames
    assert parser.refused == 0


@settings(max_examples=250, deadline=None)
@given(st.lists(FRAMES, min_size=1, max_size=4), st.data())
def test_nothing_that_was_not_sent(frames, data):
    stream = bytearray(b"".join(map(encode_frame, frames)))
    for _ in range(data.draw(st.integers(1, 6))):
        at = data.draw(st.integers(0, max(0, len(stream) - 1)))
        match data.draw(st.integers(0, 4)):
            case 0:
                stream[at : at + 1] = bytes([data.draw(st.integers(0, 255))])
            case 1:
                del stream[at : at + data.draw(st.integers(1, 5))]
            case 2:
                stream[at:at] = data.draw(st.binary(min_size=1, max_size=9))
            case 3:
                stream[at:at] = stream[max(0, at - 12) : at]
            case 4:
                del stream[at:]
    assert set(Parser().feed(bytes(stream) + b"\0")) <= set(frames)


def test_other_versions_and_overlong_frames_are_not_read():
    parser = Parser()
    assert parser.feed(encode_frame(LinkFrame(7, 3, 1, b"whatever"))) == []
    assert (parser.other_version, parser.refused) == (7, 0)
    assert parser.feed(b"\x07" * 1000) == []
    assert parser.feed(b"\0") == []
    assert parser.refused == 1
    frame = LinkFrame(1, Type.STOP, 1)
    assert parser.feed(encode_frame(frame)) == [frame]


# The protocol with the board.


class Wire:
    """A port that keeps what is written to it."""

    def __init__(self):
        self.parser, self.frames, self.takes = Parser(), [], True

    def write(self, data):
        if not self.takes:
            raise OSError
        self.frames += self.parser.feed(data)

    def close(self):
        self.takes = False

    def sent(self):
        frames, self.frames = self.frames, []
        return [frame.type for frame in frames]


class Known:
    """A drive whose board has answered at 10 s, with a clock that is set by hand."""

    def __init__(self, armed=True):
        self.time, self.wire, self.lines, self.sequence = 10.0, Wire(), [], 0
        self.drive = LinkDrive(self.wire, lambda: self.time, report=self.lines.append)
        self.welcome()
        if armed:
            assert self.drive.resume()
            self.tell()
        self.wire.sent()

    def welcome(self):
        body = struct.pack("<H8s", 1, b"maxston8")
        self.drive.handle(encode_frame(LinkFrame(1, Type.WELCOME, self.sequence, body)))

    def tell(self, armed=True, faults=0, echo=7):
        self.sequence += 1
        body = struct.pack("<HBBhhHHHHHH", echo, armed, int(faults), 500, 100, 7400, 1500, 1500, 1500, 0, 3)
        self.drive.handle(encode_frame(LinkFrame(1, Type.TELEMETRY, self.sequence, body)))

    def send(self, made):
        return self.drive.send(SafeCommand(DriveCommand(0.5, 0.1), made, _SEAL))


def test_a_loop_is_dead_after_a_patience_and_not_before():
    car = Known()
    car.send(10.0)
    car.time = 10.119
    car.tell()
    car.wire.sent()
    car.drive.look_after()
    assert (car.wire.sent(), car.drive.trouble()) == ([Type.HEARTBEAT], None)
    car.time = 10.121
    car.drive.look_after()
    assert car.wire.sent() == [Type.STOP, Type.HEARTBEAT]
    assert car.drive.trouble() == "the loop has sent nothing for 0.12 s"
    assert car.lines == ["link: the loop has sent nothing for 0.12 s"]
    # A car that stands by itself need not be told anything by its loop.
    car.time = 10.2
    car.tell(armed=False)
    car.drive.look_after()
    assert (car.wire.sent(), len(car.lines)) == ([Type.HEARTBEAT], 1)


def test_a_link_is_lost_after_a_patience_and_not_before():
    car = Known()
    car.time = 10.119
    car.send(10.119)
    car.drive.look_after()
    assert car.wire.sent() == [Type.COMMAND, Type.HEARTBEAT]
    car.time = 10.121
    car.send(10.121)
    car.wire.sent()
    car.drive.look_after()
    assert car.wire.sent() == [Type.STOP]
    assert car.drive.trouble() == "lost: no valid telemetry for 0.12 s"
    assert not car.drive.resume()
    car.drive.look_after()  # nobody there to be spoken to
    assert car.wire.sent() == []
    for at, sent in ((10.13, [Type.HELLO]), (10.229, []), (10.2301, [Type.HELLO])):
        car.time = at
        car.drive.greet()
        assert car.wire.sent() == sent
    car.welcome()
    assert car.lines[-1] == "link: connected again; the car stands until it is resumed"
    car.drive.greet()
    assert car.wire.sent() == []


def test_what_was_applied_before_a_link_was_lost_is_not_driven_after_it():
    """It would say that images stand still that must move."""
    car = Known()
    assert car.drive.driven() == car.drive.driven() == DriveCommand(0.5, 0.1)  # the second time it is the latest
    car.time += 1.0
    car.drive.look_after()
    assert car.drive.driven() == STAND
    car.welcome()
    assert car.drive.driven() == STAND
    car.tell()
    assert car.drive.driven() == DriveCommand(0.5, 0.1)


def test_an_old_command_is_not_sent_and_one_that_is_not_taken_moves_nothing():
    car = Known()
    car.time = 10.099
    assert car.send(10.0) == DriveCommand(0.5, 0.1)
    car.time = 10.101
    assert car.send(10.0) == STAND
    assert car.wire.sent() == [Type.COMMAND]
    car.wire.takes = False
    assert car.send(10.1) == STAND
    assert Known(armed=False).send(10.0) == STAND
    with pytest.raises(TypeError, match="send through a SafeDrive"):
        car.drive.send(DriveCommand(0.5, 0.0))


def test_a_board_that_stands_is_believed_once_it_must_know_that_it_may_drive():
    car = Known(armed=False)
    assert car.drive.resume()
    assert car.wire.sent() == [Type.ARM]
    car.time = 10.099
    car.tell(armed=False)
    assert car.drive.trouble() is None
    car.time = 10.101
    car.tell(armed=False)
    assert car.drive.trouble() == "the board does not resume"
    assert car.wire.sent() == [Type.STOP]
    car = Known()
    car.time = 10.2
    car.tell(armed=False, faults=LinkFault.NOISE)
    assert car.drive.trouble() == "the board has stopped: too many refused frames"
    assert car.wire.sent() == []


def test_a_drive_that_was_stopped_says_so_to_the_board_and_no_more():
    car = Known()
    car.drive.stop()
    assert car.wire.sent() == [Type.STOP]
    assert car.send(10.0) == STAND
    car.tell(armed=False)
    assert (car.drive.trouble(), car.lines) == (None, [])


def test_many_refused_frames_from_the_board_stop_it_once():
    """Five at once are too many; one in .2 s never adds up."""
    car, bad = Known(), b"\x07\0"
    for _ in range(20):
        car.time += 0.21
        car.drive.handle(bad)
    car.drive.handle(3 * bad)
    assert car.drive.trouble() is None
    car.drive.handle(2 * bad)
    car.drive.handle(b"")
    assert car.drive.trouble() == "bad line: many frames from the board are refused"
    assert (car.wire.sent(), len(car.lines)) == ([Type.STOP], 1)
    assert car.drive.resume()
    car.drive.handle(b"")
    assert car.drive.trouble() is None


def test_a_round_trip_is_the_time_from_a_heartbeat_to_its_echo():
    car = Known()
    car.drive.look_after()
    echo = car.wire.frames[-1].sequence
    car.time += 0.05
    for heard in (echo, echo, echo + 9):
        car.tell(echo=heard)
    assert list(car.drive.round_trips()) == [pytest.approx(0.05)]


# Serial ports.


def open_with(answer, **options):
    peer = Peer(answer)
    try:
        SerialDrive(peer.device, **options).close()
    finally:
        peer.close()


def test_what_cannot_be_opened(tmp_path):
    (tmp_path / "port").touch()
    peer = Peer(board)
    drive = SerialDrive(peer.device, report=lambda line: None)
    for device in ("/dev/serial/by-id/nothing", str(tmp_path / "port"), peer.device):
        with pytest.raises(InputError, match="cannot be opened"):
            SerialDrive(device)
    drive.close()
    peer.close()


def test_boards_that_do_not_answer_as_they_must(monkeypatch):
    monkeypatch.setattr(serial_drive, "GREETING", 0.6)

    def garbled(frame):
        os.write(peer.end, b"\xfe\x9c\x11\x00\xe0\xfe")
        return []

    with pytest.raises(InputError, match="no answer from the board; is the firmware on it"):
        open_with(lambda frame: [])
    peer = Peer(garbled)
    with pytest.raises(InputError, match=r"bytes came but no valid frame; is 115200 baud right"):
        SerialDrive(peer.device, 115200)
    peer.close()
    with pytest.raises(InputError, match="speaks version 2 of the protocol, this program 1"):
        open_with(lambda frame: board(frame, version=2))
    with pytest.raises(InputError, match="'lorry', the configuration is for 'maxston8'"):
        open_with(lambda frame: board(frame, name=b"lorry\0\0\0"), board_name="maxston8")


# Links by name.


class PaperSettings(Strict):
    pages: int = 3


class PaperDrive(Drive):
    """Writes down what it is told, and knows nothing else."""

    def __init__(self, pages, board_name):
        self.pages, self.board_name, self.written, self.closed = pages, board_name, [STAND], 0

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

    @link("paper")
    def open_paper(settings: PaperSettings, opening):
        made.append(PaperDrive(settings.pages, opening.board_name))
        return made[-1]

    yield made
    del LINKS["paper"]


@pytest.mark.realtime
def test_a_car_on_another_link(tmp_path, paper, monkeypatch):
    """A wall that slides past."""
    wall = np.random.default_rng(1).integers(0, 256, (48, 399, 3), dtype=np.uint8)

    class Wall(LiveCapture):
        def retrieve(self):
            return True, np.ascontiguousarray(wall[:, 2 * self.n % 300 :][:, :64])

    monkeypatch.setattr("ndtorch.scenes.readers.open_capture", lambda address: Wall(30.0))
    (tmp_path / "car.toml").write_text(
        """
board_name = "paper"
link = {kind = "paper", pages = 7}
cameras = {left = "x://left", right = "x://right", width_px = 64, height_px = 48}
rig = {width_px = 64, height_px = 48, focal_px = 43.0}
navigation = {controller = "published"}
limits = {frame_age_s = 0.2}
"""
    )
    config, steps = read_toml(tmp_path / "car.toml", RunConfig), []
    with open_car(config, lambda line: None, True, [steps.append]) as car:
        car.run(1.5)
    (drive,) = paper
    assert (drive.pages, drive.board_name) == (7, "paper")
    assert drive.closed
    assert drive.written[-1] == STAND
    assert sum(step.used for step in steps) > 10
    assert max(command.speed for command in drive.written) > 0.0
    assert {step.sent for step in steps} <= set(drive.written)


@pytest.mark.slow
def test_the_simulated_world_is_a_link():
    config = RunConfig(board_name="sim", link={"kind": "simulated-world"}, simulation={"arena": "curve", "seed": 11})
    steps = []
    with open_car(config, lambda line: None, True, [steps.append]) as car:
        assert car.run(2.0) == 61
        assert car.cameras is car.drive
    assert steps[-1].sent.speed == pytest.approx(0.5)
    assert car.drive.car.speed == 0.0


def test_a_simulated_world_needs_a_link_that_moves_it(paper):
    with pytest.raises(InputError, match=r"a simulated world is driven by link\.kind = 'simulated-board'"):
        open_link({"kind": "paper"}, Opening("x", print, object()))
    assert paper[0].closed == 1
    with pytest.raises(InputError, match=r"needs the table \[simulation\]"):
        open_link({"kind": "simulated-world"}, Opening("x", print))
