"""What is heard from the board: frames in their order, what it applies, and how bad the line is."""

from __future__ import annotations

import threading

from ndtorch_robot.link.line import Noise
from ndtorch_robot.link.messages import VERSION, Fault, Frame, Telemetry, read_telemetry
from ndtorch_robot.link.parser import Parser
from ndtorch_robot.ports import STAND, DriveCommand

MOST_APPLIED = 30
"""Commands of the board that are kept for a loop that does not ask for them."""


class Hearing:
    """One thread hears; any may ask.

    Attributes:
        parser: finds the frames.
        noise: whether too many are refused.
        telemetry: the latest, None before any.
        last: when the board was heard last, s.
        applied: by the latest telemetry since the board was greeted; standing before any.
    """

    def __init__(self) -> None:
        self.parser, self.noise = Parser(), Noise()
        self.telemetry: Telemetry | None = None
        self.last = 0.0
        self.applied = STAND
        self._sequence: int | None = None
        self._applied: list[DriveCommand] = []
        self._lock = threading.Lock()

    def begin(self) -> None:
        """The board is greeted: it may count its frames anew."""
        self._sequence = None

    def welcome(self, frame: Frame, now: float) -> None:
        """The board has answered."""
        self.last, self._sequence = now, frame.sequence
        self.applied = STAND  # what it applied before the line was lost is long over
        self.noise.count = 0

    def take(self, frame: Frame, now: float) -> Telemetry | None:
        """What a frame of telemetry says; None if it was seen already, or is older than one that was."""
        if self._sequence is not None and not 0 < (frame.sequence - self._sequence) & 0xFFFF < 0x8000:
            self.parser.refused += 1
            return None
        self.telemetry = telemetry = read_telemetry(frame.body)
        self._sequence, self.last, self.applied = frame.sequence, now, telemetry.applied
        with self._lock:
            self._applied.append(telemetry.applied)
            del self._applied[:-MOST_APPLIED]
        return telemetry

    def other_version(self) -> str | None:
        """What to do about another version of the protocol, if one was heard since this was last asked."""
        other, self.parser.other_version = self.parser.other_version, None
        if other is None:
            return None
        return (
            f"the board speaks version {other} of the protocol, this program {VERSION}: "
            "flash it with make -C robot/firmware flash"
        )

    def silence(self, baud: int) -> str:
        """Why there may be no answer."""
        count = self.parser.received
        if count == 0:
            return "no answer from the board; is the firmware on it? (make -C robot/firmware flash)"
        return f"{count} bytes came but no valid frame; is {baud} baud right?"

    def bad(self, now: float) -> bool:
        """Whether too many frames are refused."""
        return self.noise.bad(self.parser.refused, now)

    def driven(self) -> DriveCommand | None:
        """Mean of the speeds and curvatures applied since this was last asked, None for none."""
        with self._lock:
            applied, self._applied = self._applied, []
        if not applied:
            return None
        count = len(applied)
        return DriveCommand(sum(a.speed for a in applied) / count, sum(a.curvature for a in applied) / count)


def news(before: Telemetry | None, now: Telemetry) -> list[str]:
    """Faults that need no stop and were not there before, in words."""
    new = now.faults & ~(before.faults if before is not None else Fault(0))
    lines = {
        Fault.BATTERY: f"battery low, {now.battery:.1f} V",
        Fault.WATCHDOG: "the board was reset by its watchdog timer",
    }
    return [line for fault, line in lines.items() if fault in new]
