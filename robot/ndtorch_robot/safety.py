"""The safety layer between navigator and drive: every command to the wheels passes through it."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch_robot.camera_monitor import CameraMonitor
from ndtorch_robot.faults import FaultKind, Stop
from ndtorch_robot.ports import _SEAL, STAND, Clock, Drive, DriveCommand, Report, SafeCommand, StereoFrames

WISH = 10.0
"""Seconds for which a resumed car keeps trying while its drive cannot obey yet."""

AGAIN = 1.0
"""Seconds between two such attempts."""


@dataclass(frozen=True)
class SafetyLimits:
    """Limits of the safety layer.

    The defaults limit nothing, for simulated drives, which have limits of their own.

    Args:
        speed: fastest, m/s. More is a fault.
        curvature: tightest, 1/m. More is a fault.
        acceleration: m/s^2; the speed sent follows no faster. Slowing down is not limited.
        steering: 1/m a second; the curvature sent follows no faster.
        silence: longest time between two commands, s. More is a fault.
        age: oldest frames that may be steered by, s. Older is a fault.
        recovery: time for which all must be well before the car drives on after a passing fault, s.

    Raises:
        InputError: a limit below 0, or one that is no number: it would let everything through.
    """

    speed: float = math.inf
    curvature: float = math.inf
    acceleration: float = math.inf
    steering: float = math.inf
    silence: float = math.inf
    age: float = math.inf
    recovery: float = 1.0

    def __post_init__(self) -> None:
        check_numbers(self, endless=["recovery"], positive=())


class SafeDrive:
    """A drive with the safety layer around it, the only means to move a car.

    Drives obey nothing but a `SafeCommand`, only `send` of this class makes those, and the loop accepts no other
    drive. After a fault that passes, such as late frames, the car stops until all has been well for
    `limits.recovery` seconds. After another one, such as a lost link, it needs `resume`; see `FaultKind`.

    A `resume` is not lost: while the drive cannot obey, or fails again before the car has moved, it is repeated until
    the car moves, a person stops it, or its time is over, which is reported.

    Args:
        drive: moves the car.
        clock: of the loop, monotonic.
        limits: see `SafetyLimits`.
        frame_check: judges frames; without good frames no command passes. None for a loop without cameras.
        report: called with one line for every fault and every resumption.

    Attributes:
        standing: the reason for which the car is stopped, or None.
        kind: of the fault that stops it, or None.
        faults: all stops so far.
        by_hand: a person has stopped the car since it was last resumed.
    """

    def __init__(
        self,
        drive: Drive,
        clock: Clock,
        limits: SafetyLimits | None = None,
        frame_check: CameraMonitor | None = None,
        report: Report | None = None,
    ) -> None:
        self.drive, self.clock, self.limits, self.frame_check = drive, clock, limits or SafetyLimits(), frame_check
        self.report = report or (lambda line: None)
        self.lock = threading.RLock()
        self.standing: str | None = None
        self.kind: FaultKind | None = None
        self.auto_recover = True
        self.well_since = math.inf
        self.seen = -math.inf
        self.blindness: str | None = "no frames yet"
        self.sent = STAND
        self.sent_at: float | None = None
        self.faults: list[Stop] = []
        self.interrupted, self.by_hand = False, False
        self.wish_ends: float | None = None  # resumed, but not moving yet
        self.tried = -math.inf

    def see(self, frames: StereoFrames, speed: float, curvature: float = 0.0) -> bool:
        """Judge new frames; True when the car may be steered by them.

        Args:
            speed, curvature: of the car since the last ones, m/s and 1/m.
        """
        assert self.frame_check is not None
        fault = self.frame_check.judge(frames, speed, self.clock.now())
        if fault is not None:
            self.blind(fault.message, fault.kind)
            return False
        self.seen, self.blindness = frames.time, None
        return True

    def driven(self) -> DriveCommand:
        """Motion since the last call, as of the drive; numbers that are not finite stop the car and count as none."""
        driven = self.drive.driven()
        if math.isfinite(driven.speed + driven.curvature):
            return driven
        self.fault(f"the odometry is not finite: {driven}", FaultKind.DRIVE)
        return STAND

    def blind(self, why: str, kind: FaultKind = FaultKind.MISSING) -> None:
        self.blindness = why
        self.fault(why, kind)

    def fault(self, why: str, kind: FaultKind) -> None:
        with self.lock:
            self.well_since, self.interrupted = math.inf, True
            if self.standing is not None:
                self.auto_recover = self.auto_recover and kind.auto_recover
                return
            self.standing, self.kind, self.auto_recover, self.sent = why, kind, kind.auto_recover, STAND
            self.drive.stop()
            self.faults.append(Stop(self.clock.now(), why, kind))
        self.report(f"stopped: {why}")

    def take_interruption(self) -> bool:
        """Whether the car was stopped, or saw nothing, since the last call, or is stopped now."""
        with self.lock:
            was, self.interrupted = self.interrupted or self.standing is not None, False
            return was

    def send(self, command: DriveCommand) -> DriveCommand:
        """Ask for a speed and a curvature; returns what was sent. What is not finite stops the car: `InputError`."""
        now = self.clock.now()
        command = unrounded(command, self.limits)
        with self.lock:
            self.look_for_faults(command, now)
            elapsed = 0.0 if self.sent_at is None else now - self.sent_at
            self.sent_at = now
            if self.standing is not None:
                self.try_to_go_on(now)
                wanted = STAND
            else:
                wanted = self.limited(command, elapsed)
            self.sent = self.drive.send(SafeCommand(wanted, now, _SEAL))
            if self.sent.speed:
                self.wish_ends = None
            return self.sent

    def look_for_faults(self, command: DriveCommand, now: float) -> None:
        limits = self.limits
        if not (math.isfinite(command.speed) and math.isfinite(command.curvature)):
            self.fault(f"the command is not finite: {command}", FaultKind.COMMAND)
            raise InputError(f"commands must be finite, got {command}")
        trouble = self.drive.trouble()
        if trouble is not None:
            self.fault(trouble, FaultKind.DRIVE)
        if self.sent_at is not None and now - self.sent_at > limits.silence:
            self.fault(f"a step took {now - self.sent_at:.3f} s, {limits.silence:.3f} s are allowed", FaultKind.SILENCE)
        if abs(command.speed) > limits.speed or abs(command.curvature) > limits.curvature:
            self.fault(
                f"the command is out of limits: {command.speed:.2f} m/s and {command.curvature:.2f} 1/m, "
                f"{limits.speed:.2f} and {limits.curvature:.2f} are allowed",
                FaultKind.LIMITS,
            )
        if self.frame_check is not None and self.blindness is None and now - self.seen > limits.age:
            self.blind(f"the frames are {now - self.seen:.3f} s old", FaultKind.AGE)

    def try_to_go_on(self, now: float) -> None:
        """Drive on after a passing fault, or when a person has resumed the car."""
        if self.frame_check is not None and self.blindness is not None:
            self.well_since = math.inf
        elif self.auto_recover:
            self.well_since = min(self.well_since, now)
            if now - self.well_since >= self.limits.recovery:
                self.go_on(now)
        elif self.wish_ends is not None and now >= self.wish_ends:
            self.wish_ends = None
            self.report("not resumed: the drive did not obey in time; resume it again")
        elif self.wish_ends is not None and now >= self.tried + AGAIN:
            self.go_on(now)

    def go_on(self, now: float) -> bool:
        """Make the drive obey from the next command on; False when it cannot."""
        self.tried = now
        if not self.drive.resume():
            return False
        was, self.standing, self.kind, self.auto_recover = self.standing, None, None, True
        if self.frame_check is not None:
            self.frame_check.reset()
        self.well_since, self.sent = math.inf, STAND
        self.report(f"resumed after: {was}")
        return True

    def limited(self, command: DriveCommand, elapsed: float) -> DriveCommand:
        """The command, no further from the one before than the limits allow; towards standing at once."""
        limits, before = self.limits, self.sent
        gain = limits.acceleration * elapsed if elapsed else (0.0 if limits.acceleration < math.inf else math.inf)
        turn = limits.steering * elapsed if elapsed else (0.0 if limits.steering < math.inf else math.inf)
        speed = command.speed
        if speed * before.speed < 0 and limits.acceleration < math.inf:
            speed = 0.0  # not through zero in one step
        if abs(speed) > abs(before.speed) + gain:
            speed = math.copysign(abs(before.speed) + gain, speed)
        curvature = min(max(command.curvature, before.curvature - turn), before.curvature + turn)
        return DriveCommand(speed, curvature)

    def resume(self, patience: float | None = WISH) -> None:
        """Drive again from the next command on, if nothing is wrong any more.

        Args:
            patience: seconds for which to keep trying while the drive cannot; None is until it can.
        """
        with self.lock:
            self.by_hand = False
            if self.standing is None and self.sent.speed:
                return
            now = self.clock.now()
            self.wish_ends = math.inf if patience is None else now + patience
            if self.standing is not None and not self.go_on(now):
                self.report(f"resuming waits until the drive can: {self.drive.trouble() or self.standing}")

    def emergency(self, why: str) -> None:
        """Stop now; from any thread. Only `resume` ends it."""
        self.drive.stop()  # before waiting for anybody
        self.wish_ends, self.by_hand = None, True
        if self.standing is not None:
            self.report(f"emergency stop: {why}; it was stopped already: {self.standing}")
        self.fault(f"emergency stop: {why}", FaultKind.EMERGENCY)

    def stop(self) -> None:
        """Stop until `resume`; the end of every drive."""
        self.drive.stop()
        with self.lock:
            self.wish_ends = None
            self.standing, self.kind = self.standing or "told to stop", self.kind or FaultKind.EMERGENCY
            self.auto_recover, self.sent = False, STAND


def unrounded(command: DriveCommand, limits: SafetyLimits) -> DriveCommand:
    """The command; one that is a limit in single precision, a hair above it, is the limit itself."""

    def to_limit(value: float, limit: float) -> float:
        return math.copysign(limit, value) if limit < abs(value) <= limit * (1 + 1e-6) else value

    return DriveCommand(to_limit(command.speed, limits.speed), to_limit(command.curvature, limits.curvature))
