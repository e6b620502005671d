"""The drive at the other end of a line: errors on opening, round trips, and a line that is lost."""

import errno
import os
import threading
from types import SimpleNamespace

import pytest
from fastcrc import crc16
from hypothesis import given, settings
from hypothesis import strategies as st

from ndtorch.errors import InputError
from ndtorch_robot.link import SerialDrive, serial_drive
from ndtorch_robot.link.line import Line, LinkQuality, owner_group, reason
from ndtorch_robot.link.messages import BODY_SIZE, Frame, Type, command_body, encode_frame, read_command, read_telemetry
from ndtorch_robot.link.receiver import Parser
from ndtorch_robot.ports import DriveCommand
from tests.robot.link.test_registry import Known
from tests.robot.support.peer import Peer, board


def open_with(answer, **options):
    peer = Peer(answer)
    try:
        SerialDrive(peer.device, greeting=0.6, **options).close()
    finally:
        peer.close()


def test_no_such_device():
    with pytest.raises(InputError, match="no such device; is the board plugged in"):
        SerialDrive("/dev/serial/by-id/nothing")


def test_no_permission_names_the_group(tmp_path):
    file = tmp_path / "port"
    file.touch()
    message = reason(str(file), errno.EACCES, "")
    assert f"usermod -aG {owner_group(file)}" in message


def test_a_file_is_no_port(tmp_path):
    file = tmp_path / "port"
    file.touch()
    with pytest.raises(InputError, match="is no serial port"):
        SerialDrive(str(file))


def test_in_use():
    peer = Peer(board)
    drive = SerialDrive(peer.device, report=lambda line: None)
    with pytest.raises(InputError, match="in use by another program"):
        SerialDrive(peer.device)
    drive.close()
    peer.close()


def test_no_answer():
    with pytest.raises(InputError, match="no answer from the board; is the firmware on it"):
        open_with(lambda frame: [])


def test_wrong_baud():
    def garbled(frame):
        os.write(peer.end, b"\xfe\x9c\x11\x00\xe0\xfe")
        return []

    peer = Peer(garbled)
    with pytest.raises(InputError, match=r"bytes came but no valid frame; is 115200 baud right"):
        SerialDrive(peer.device, 115200, greeting=0.6)
    peer.close()


def test_other_version_and_other_robot():
    with pytest.raises(InputError, match="speaks version 2 of the protocol, this program 1"):
        open_with(lambda frame: board(frame, version=2))
    with pytest.raises(InputError, match="'lorry', the configuration is for 'maxston8'"):
        open_with(lambda frame: board(frame, name=b"lorry\0\0\0"), robot="maxston8")


def test_refuses_commands_from_elsewhere():
    peer = Peer(board)
    drive = SerialDrive(peer.device, report=lambda line: None)
    with pytest.raises(TypeError, match="send through a SafeDrive"):
        drive.send(DriveCommand(0.5, 0.0))
    drive.close()
    peer.close()


def test_a_round_trip_is_the_time_from_a_heartbeat_to_its_echo():
    clock = [1.0]
    line = Line(SimpleNamespace(write=lambda data: None), lambda: clock[0])
    for _ in range(3):
        line.write(Type.HEARTBEAT)
        clock[0] += 0.5
    line.echoed(2, 2.0)
    line.echoed(2, 9.0)
    line.echoed(7, 9.0)
    assert list(line.trips) == [0.5]


def test_so_many_refused_frames_are_noise() -> None:
    """Five at once are too much: one is forgiven, three are borne. What comes slowly never adds up."""
    noise = LinkQuality()
    assert [noise.bad(refused, 10.0) for refused in (1, 2, 3, 4, 5)] == [False, False, False, False, True]
    assert not noise.bad(5, 20.0)
    assert not any(noise.bad(5 + n, 20.0 + 0.5 * n) for n in range(1, 20))
    assert noise.bad(30, 29.6)
    assert LinkQuality().bad(4, 0.9) is False, "what came at once since the start of the clock is forgiven once"
    assert LinkQuality().bad(4, 0.1)


def test_a_board_that_never_answers_is_given_up(monkeypatch):
    """After twice the time that it is given at first, counted from when it was heard last."""
    car = Known()
    drive = SerialDrive.__new__(SerialDrive)
    vars(drive).update(vars(car.drive))
    drive.closing = threading.Event()
    car.line.port = "a port"
    clock, read = [100.0], []

    def read_some(port):
        read.append(clock[0])
        clock[0] += 0.25
        return b""

    monkeypatch.setattr(serial_drive, "read_some", read_some)
    monkeypatch.setattr(serial_drive.time, "monotonic", lambda: clock[0])
    drive.welcomed.clear()
    assert drive.converse() == "no answer from the board"
    given = 2 * serial_drive.GREETING
    assert read[-1] == pytest.approx(100.0 + given, abs=0.25)
    drive.receiver.last, clock[0], read[:] = 103.0, 100.0, []
    assert drive.converse() == "no answer from the board"
    assert read[-1] == pytest.approx(103.0 + given, abs=0.25)
    drive.closing.set()
    assert drive.converse() == "closed"


def test_a_line_that_is_gone_is_not_written_to_and_opened_again_after_pauses_that_grow():
    car = Known()
    drive = SerialDrive.__new__(SerialDrive)
    vars(drive).update(vars(car.drive))
    waited, dropped, opened = [], [], []

    class Closing(threading.Event):
        def wait(self, timeout):
            waited.append(timeout)
            return False

    def reopen():
        opened.append(len(waited))
        return len(opened) in (4, 5)

    def converse():
        if len(dropped) == 2:
            drive.closing.set()
        return "unplugged"

    drive.closing, drive.converse, drive.receiver.telemetry = Closing(), converse, None
    car.line.drop, car.line.reopen = (lambda: dropped.append(True)), reopen
    drive.listen()
    assert (car.line.said(), len(dropped), drive.welcomed.is_set()) == ([], 2, False)
    assert (drive.trouble(), car.lines) == ("lost: unplugged", ["link: lost: unplugged"])
    least, most = serial_drive.BACK_OFF
    assert waited == [min(least * 2**n, most) for n in range(5)]


FRAMES = st.sampled_from(list(Type)).flatmap(
    lambda kind: st.builds(
        Frame,
        st.just(1),
        st.just(int(kind)),
        st.integers(0, 65535),
        st.binary(min_size=BODY_SIZE[kind], max_size=BODY_SIZE[kind]),
    )
)


def test_frames_as_they_go_over_the_line():
    assert encode_frame(Frame(1, Type.HELLO, 0)).hex() == "030101010544c5af2400"
    command = Frame(1, Type.COMMAND, 65535, command_body(DriveCommand(0.5, -2.0)))
    assert encode_frame(command).hex() == "0d0103fffff40130f871a9d1f300"


def division(data, polynomial, start):
    """CRC bit by bit, as the polynomial is divided on paper."""
    crc = start
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (polynomial if crc & 0x8000 else 0)) & 0xFFFF
    return crc


def mirrored(value, bits):
    return int(f"{value:0{bits}b}"[::-1], 2)


@given(st.binary(max_size=40))
def test_checksums(data):
    assert crc16.ibm_3740(data) == division(data, 0x1021, 0xFFFF)
    assert crc16.dnp(data) == mirrored(division(bytes(mirrored(b, 8) for b in data), 0x3D65, 0), 16) ^ 0xFFFF
    assert crc16.ibm_3740(b"123456789") == 0x29B1
    assert crc16.dnp(b"123456789") == 0xEA82


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


@given(st.binary(max_size=400))
def test_any_bytes_at_all(data):
    parser = Parser()
    parser.feed(data)
    assert len(parser.collected) <= 31


def test_other_version_is_named_and_not_read():
    parser = Parser()
    assert parser.feed(encode_frame(Frame(7, 3, 1, b"whatever"))) == []
    assert parser.other_version == 7
    assert parser.refused == 0


def test_overlong_frames_are_refused():
    parser = Parser()
    parser.feed(b"\x07" * 1000)
    assert parser.feed(b"\0") == []
    assert parser.refused == 1
    frame = Frame(1, Type.STOP, 1)
    assert parser.feed(encode_frame(frame)) == [frame]


@pytest.mark.parametrize("command", [DriveCommand(0.5, -2.0), DriveCommand(-1.0, 0.001)])
def test_units(command):
    assert read_command(command_body(command)) == command
    assert command_body(DriveCommand(0.5, -2.0)) == bytes([0xF4, 0x01, 0x30, 0xF8])


def test_telemetry():
    body = bytes([5, 0, 1, 16, 0xF4, 1, 0x18, 0xFC, 0xE8, 0x1C, 0x5E, 6, 0xDC, 5, 0xDC, 5, 3, 0, 60, 0])
    t = read_telemetry(body)
    assert (t.echo, t.armed, t.applied, t.battery, t.motor, t.rejected, t.uptime) == (
        5,
        True,
        (0.5, -1.0),
        7.4,
        1630,
        3,
        60,
    )
    assert t.why() == "battery low"
