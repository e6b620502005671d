"""From a stream of bytes to frames."""

from __future__ import annotations

from ndtorch_robot.link.messages import BODY_SIZE, VERSION, Frame, decode_frame

LONGEST = 31
"""Bytes of the longest frame without its zero: four of header, 22 of body, four of checks, one of stuffing."""


class Parser:
    """Collects bytes and gives out the frames among them that are without error.

    Attributes:
        refused: frames with an error in them, so far.
        other_version: version of the last good frame that was not of this version, or None.
        received: bytes so far.
    """

    def __init__(self) -> None:
        self.collected = bytearray()
        self.overlong = False
        self.refused = 0
        self.received = 0
        self.other_version: int | None = None

    def feed(self, data: bytes) -> list[Frame]:
        """The frames that end in these bytes."""
        self.received += len(data)
        frames = []
        *ended, rest = data.split(b"\0")
        for part in ended:
            frame = self.end(part)
            if frame is not None:
                frames.append(frame)
        self.collect(rest)
        return frames

    def collect(self, part: bytes) -> None:
        """Bytes inside a frame; more than any frame has are not kept."""
        room = LONGEST - len(self.collected)
        self.overlong |= len(part) > room
        self.collected += part[:room]

    def end(self, part: bytes) -> Frame | None:
        """A zero byte has come."""
        self.collect(part)
        coded, overlong = bytes(self.collected), self.overlong
        self.collected.clear()
        self.overlong = False
        if not coded:
            return None
        frame = None if overlong else decode_frame(coded)
        if frame is None:
            self.refused += 1
            return None
        if frame.version != VERSION:
            self.other_version = frame.version
            return None
        if len(frame.body) != BODY_SIZE.get(frame.type, -1):  # type: ignore[call-overload]
            self.refused += 1
            return None
        return frame
