"""The safety layer between navigator and drive: every command to the wheels passes through it."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from enum import Enum, auto
from typing import TYPE_CHECKING

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch_robot.ports import (
    _SEAL,
    STAND,
    Clock,
    Drive,
    DriveCommand,
    Fault,
    FaultKind,
    Report,
    SafeCommand,
    StereoFrames,
)

if TYPE_CHECKING:
    from ndtorch_robot.camera_monitor import CameraMonitor

PATIENCE, RETRY = 10.0, 1.0
"""Seconds for which a resumed car keeps trying while its drive cannot obey yet, and between two attempts."""

NOT_STARTED = "not started"


@dataclass(frozen=True)
class SafetyLimits:
    """`[limits]`: limits of the safety layer; without numbers for simulated drives, which have limits of their own.

    Raises:
        InputError: a limit below 0, or one that is no number: it would let everything through.
    """

    speed_m_per_s: float = math.inf
    """Highest speed of a command, in m/s; 1.2 times cruise speed in the file of a car."""
    curvature_per_m: float = math.inf
    """Tightest curve of a command, in 1/m; what the body can do in the file of a car."""
    acceleration_m_per_s2: float = math.inf
    """Fastest increase of speed, in m/s^2; .8 times that of the body in the file of a car."""
    steering_per_m_per_s: float = math.inf
    """Fastest change of curvature, in 1/m a second; lock to lock in .1 s in the file of a car."""
    step_s: float = math.inf
    """Longest time between two commands, in s; more is a fault; .1 in the file of a car."""
    frame_age_s: float = math.inf
    """Age of the oldest frames to steer by, in s; more is a fault; .1 in the file of a car."""
    recovery_s: float = 1.0
    """Time without a fault after which the car drives on by itself, in s."""

    def __post_init__(self) -> None:
        check_numbers(self, endless=["recovery_s"], positive=())


class DriveState(Enum):
    """State of a `SafeDrive`."""

    DRIVING = auto()  # commands pass
    RECOVERING = auto()  # stopped by a passing fault; drives on once all has been well for long enough
    STOPPED = auto()  # stopped until `resume`
    RESUMING = auto()  # resumed, and tried again until the car has moved, or the time for that is over


class SafeDrive:
    """A drive with the safety layer around it, the only means to move a car.

    Drives obey nothing but a `SafeCommand`, only `send` of this class makes those, and the loop accepts no other
    drive. Commands beyond a limit are clamped. After a fault that passes, such as late frames, the car stops until all
    has been well for `limits.recovery_s` seconds. After another one, such as a lost link, it needs `resume`; see
    `FaultKind`.

    Args:
        drive: moves the car.
        clock: of the loop, monotonic.
        limits: see `SafetyLimits`.
        frame_check: judges frames; without good frames no command passes. None for a loop without cameras.
        report: called with one line for every fault and every resumption.

    Attributes:
        state: see `DriveState`.
        standing: the reason for which no command passes, or None.
        faults: all stops by a fault so far.
        clamped: number of commands beyond a limit.
        sent: the last command, as the drive had it.
        frames_time: of the last frames, if they were good, else -inf.
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
        self.state = DriveState.DRIVING
        self.standing: str | None = None
        self.faults: list[Fault] = []
        self.clamped, self.sent, self.frames_time = 0, STAND, -math.inf
        self.sent_at: float | None = None
        self.retry_at = self.resume_until = math.inf
        self.interrupted = False

    def see(self, frames: StereoFrames, speed: float) -> bool:
        """Judge new frames; True when the car may be steered by them. `speed`: of the car since the last ones, m/s."""
        assert self.frame_check is not None
        fault = self.frame_check.judge(frames, speed, self.clock.now())
        if fault is not None:
            self.blind(fault.message, fault.kind)
            return False
        self.frames_time = frames.time
        return True

    def driven(self) -> DriveCommand:
        """Motion since the last call, as of the drive; numbers that are not finite stop the car and count as none."""
        driven = self.drive.driven()
        if math.isfinite(driven.speed + driven.curvature):
            return driven
        self.fault(f"the odometry is not finite: {driven}", FaultKind.DRIVE)
        return STAND

    def blind(self, why: str, kind: FaultKind = FaultKind.MISSING) -> None:
        """A fault of the cameras: no command passes until frames are good again."""
        self.frames_time = -math.inf
        self.fault(why, kind)

    def fault(self, why: str, kind: FaultKind) -> None:
        """Stop the car, or keep it stopped."""
        with self.lock:
            self.interrupted = True
            if self.state in (DriveState.DRIVING, DriveState.RECOVERING):
                self.state = DriveState.RECOVERING if kind.auto_recover else DriveState.STOPPED
                self.retry_at = math.inf
            if self.standing is not None:
                return
            self.standing, self.sent = why, STAND
            self.drive.stop()
            self.faults.append(Fault(kind, why, self.clock.now()))
        self.report(f"stopped: {why}")

    def take_interruption(self) -> bool:
        """Whether the car was stopped, or saw nothing, since the last call, or is stopped now."""
        with self.lock:
            was, self.interrupted = self.interrupted or self.standing is not None, False
            return was

    def send(self, command: DriveCommand) -> DriveCommand:
        """Ask for a speed and a curvature; returns what was sent. What is not finite stops the car: `InputError`."""
        now, limits = self.clock.now(), self.limits
        with self.lock:
            if not math.isfinite(command.speed + command.curvature):
                self.fault(f"the command is not finite: {command}", FaultKind.COMMAND)
                raise InputError(f"commands must be finite, got {command}")
            elapsed = 0.0 if self.sent_at is None else now - self.sent_at
            trouble = self.drive.trouble()
            if trouble is not None:
                self.fault(trouble, FaultKind.DRIVE)
            if elapsed > limits.step_s:
                self.fault(f"a step took {elapsed:.3f} s, {limits.step_s:.3f} s are allowed", FaultKind.SILENCE)
            if self.frame_check is not None and limits.frame_age_s < now - self.frames_time < math.inf:
                self.blind(f"the frames are {now - self.frames_time:.3f} s old", FaultKind.AGE)
            self.sent_at, wanted = now, STAND
            if self.standing is None:
                wanted = self.limited(command, elapsed)
            else:
                self.try_to_go_on(now)
            self.sent = self.drive.send(SafeCommand(wanted, now, _SEAL))
            if self.sent.speed and self.state is DriveState.RESUMING:
                self.state = DriveState.DRIVING
            return self.sent

    def limited(self, command: DriveCommand, elapsed: float) -> DriveCommand:
        """The command within the limits, and no further from the one before than they allow; standing is at once."""
        limits, before = self.limits, self.sent
        speed = min(max(command.speed, -limits.speed_m_per_s), limits.speed_m_per_s)
        curvature = min(max(command.curvature, -limits.curvature_per_m), limits.curvature_per_m)
        # A limit in single precision may lie a hair above itself.
        self.clamped += not (math.isclose(speed, command.speed) and math.isclose(curvature, command.curvature))
        if limits.acceleration_m_per_s2 < math.inf:
            if speed * before.speed < 0:
                speed = 0.0  # not through zero in one step
            most = abs(before.speed) + limits.acceleration_m_per_s2 * elapsed
            speed = min(max(speed, -most), most)
        if limits.steering_per_m_per_s < math.inf:
            turn = limits.steering_per_m_per_s * elapsed
            curvature = min(max(curvature, before.curvature - turn), before.curvature + turn)
        return DriveCommand(speed, curvature)

    def try_to_go_on(self, now: float) -> None:
        """Drive on after a passing fault, or when a person has resumed the car."""
        if self.frame_check is not None and self.frames_time == -math.inf:
            if self.state is DriveState.RECOVERING:
                self.retry_at = math.inf
        elif self.state is DriveState.RECOVERING and self.retry_at == math.inf:
            self.retry_at = now + self.limits.recovery_s
        elif self.state is DriveState.RESUMING and now >= self.resume_until:
            self.state = DriveState.STOPPED
            self.report("not resumed: the drive did not obey in time; resume it again")
        elif self.state is not DriveState.STOPPED and now >= self.retry_at:
            self.go_on(now)

    def go_on(self, now: float) -> None:
        """Make the drive obey from the next command on, if it can."""
        self.retry_at = now + RETRY
        if not self.drive.resume():
            return
        if self.frame_check is not None:
            self.frame_check.reset()
        was, self.standing, self.sent = self.standing, None, STAND
        if self.state is DriveState.RECOVERING:
            self.state = DriveState.DRIVING
        self.report("started" if was in (None, NOT_STARTED) else f"resumed after: {was}")

    def resume(self, patience: float = PATIENCE) -> None:
        """Drive again from the next command on; tried for so many seconds while the drive cannot."""
        with self.lock:
            if self.standing is None and self.sent.speed:
                return
            now = self.clock.now()
            self.state, self.resume_until, self.retry_at = DriveState.RESUMING, now + patience, -math.inf
            if self.standing is not None:
                self.try_to_go_on(now)
            if self.standing is not None:
                self.report(f"resumes as soon as it can: {self.drive.trouble() or self.standing}")

    def wait_for_start(self, go: bool) -> None:
        """Stand until `resume`, or, with `go`, until frames are good and the drive obeys."""
        with self.lock:
            self.standing, self.retry_at, self.resume_until = NOT_STARTED, -math.inf, math.inf
            self.state = DriveState.RESUMING if go else DriveState.STOPPED

    def emergency(self, why: str) -> None:
        """Stop now; from any thread. Only `resume` ends it."""
        self.drive.stop()  # before waiting for anybody
        with self.lock:
            if self.standing is not None:
                self.report(f"emergency stop: {why}; it was stopped already: {self.standing}")
            self.fault(f"emergency stop: {why}", FaultKind.EMERGENCY)
            self.state = DriveState.STOPPED

    def stop(self) -> None:
        """Stop until `resume`; the end of every drive."""
        self.drive.stop()
        with self.lock:
            self.standing, self.state, self.sent = self.standing or "told to stop", DriveState.STOPPED, STAND
