"""The drive at the other end of a line: errors on opening, round trips, and a line that is lost."""

import errno
import os
from types import SimpleNamespace

import pytest

from ndtorch.errors import InputError
from ndtorch_robot.link import SerialDrive
from ndtorch_robot.link.line import Line, LinkQuality, owner_group, reason
from ndtorch_robot.link.messages import Type
from ndtorch_robot.ports import DriveCommand
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
