"""Frames of the drive link: what goes in comes out, and what was not sent never does."""

import pytest
from fastcrc import crc16
from hypothesis import given, settings
from hypothesis import strategies as st

from ndtorch_robot.link.messages import BODY_SIZE, Frame, Type, command_body, encode_frame, read_command, read_telemetry
from ndtorch_robot.link.receiver import Parser
from ndtorch_robot.ports import DriveCommand

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
