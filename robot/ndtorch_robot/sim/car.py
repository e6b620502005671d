"""The car: front and rear wheels that counter-steer, with limits on how fast speed and steering can change."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from ndtorch.errors import InputError
from ndtorch.navigation import Body
from ndtorch_robot.ports import STAND, DriveCommand


@dataclass(frozen=True)
class CarLimits:
    """What the car can do. [A] gives speed and radius; the steering is that of model-car servos, from lock to lock.

    Args:
        speed: fastest, m/s, forward and backward.
        curvature: tightest, 1/m.
        acceleration: m/s^2, also when braking.
        steering: how fast the curvature can change, 1/m a second.
    """

    speed: float = 1.0
    curvature: float = 2.2
    acceleration: float = 2.5
    steering: float = 8.0

    @classmethod
    def of(cls, body: Body) -> CarLimits:
        """Of a robot with this body, which steers from lock to lock in the time of the car of [A]."""
        if body == Body():
            return cls()
        tightest = body.max_curvature_per_m
        steering = tightest * cls.steering / cls.curvature
        return cls(body.max_speed_m_per_s, tightest, body.max_acceleration_m_per_s2, steering)


class Car:
    """Where the car is and what it does. Pose: x, y in m and heading in radians of the middle of its body.

    Args:
        limits: what it can do.
        backlash: curvature by which the wheels may differ from the servo, 1/m.
        delay: time until a command takes effect, s.
    """

    def __init__(self, limits: CarLimits | None = None, backlash: float = 0.0, delay: float = 0.0) -> None:
        self.limits, self.backlash, self.delay = limits or CarLimits(), backlash, delay
        self.queue: deque[tuple[float, DriveCommand]] = deque()
        self.place(0.0, 0.0, 0.0)

    def place(self, x: float, y: float, heading: float) -> None:
        """Move the car there; it is stationary."""
        self.x, self.y, self.heading = x, y, heading
        self.speed = self.curvature = self.servo = 0.0
        self.wanted = STAND
        self.length = self.turned = self.seconds = 0.0

    def send(self, command: DriveCommand, now: float = 0.0) -> DriveCommand:
        """Ask for a speed and a curvature; returns what it will do, which is within its limits."""
        if not (math.isfinite(command.speed) and math.isfinite(command.curvature)):
            raise InputError(f"commands must be finite, got {command}")
        most = self.limits
        speed = min(max(command.speed, -most.speed), most.speed)
        within = DriveCommand(speed, min(max(command.curvature, -most.curvature), most.curvature))
        if self.delay:
            self.queue.append((now + self.delay, within))
        else:
            self.wanted = within
        return within

    def stop(self) -> None:
        """Stand at once, and forget all commands."""
        self.queue.clear()
        self.wanted, self.speed = STAND, 0.0

    def advance(self, dt: float, now: float = 0.0) -> None:
        """Drive for `dt` seconds, until `now`: the exact arc at the speed and curvature reached by then."""
        while self.queue and self.queue[0][0] <= now + 1e-9:
            self.wanted = self.queue.popleft()[1]
        most = self.limits
        self.speed = approach(self.speed, self.wanted.speed, most.acceleration * dt)
        self.servo = approach(self.servo, self.wanted.curvature, most.steering * dt)
        self.curvature = min(max(self.curvature, self.servo - self.backlash), self.servo + self.backlash)
        length = self.speed * dt
        half = self.curvature * length / 2
        chord = length * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
        self.x += chord * math.cos(self.heading + half)
        self.y += chord * math.sin(self.heading + half)
        self.heading += 2 * half
        self.length += length
        self.turned += 2 * half
        self.seconds += dt

    def driven(self) -> DriveCommand:
        """Mean speed and curvature since this was last asked."""
        speed = self.length / self.seconds if self.seconds else 0.0
        curvature = self.turned / self.length if abs(self.length) > 1e-9 else 0.0
        self.length = self.turned = self.seconds = 0.0
        return DriveCommand(speed, curvature)


def approach(value: float, goal: float, most: float) -> float:
    return value + min(max(goal - value, -most), most)
