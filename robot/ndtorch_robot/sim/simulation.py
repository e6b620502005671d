"""The simulated robot in its building: cameras, drive, odometer and clock of the loop, and the collisions."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
import torch

from ndtorch.navigation import Body, Rect, StereoRig, Strips
from ndtorch.navigation.stereo.strips import row_rect
from ndtorch_robot.ports import STAND, CameraPair, Clock, Drive, DriveCommand, Placed, SafeCommand, StereoFrames, unseal
from ndtorch_robot.sim._kernels import rasterise, rectangle_touches
from ndtorch_robot.sim.disturbances import Disturbances, Effects
from ndtorch_robot.sim.plan import Floats, Plan, SpawnPoints
from ndtorch_robot.sim.textures import Image
from ndtorch_robot.sim.world import World, build

Odometry = Literal["true", "noisy"]

SCALE_ERROR, DRIFT = 0.01, math.radians(0.05)
"""Noisy odometry: every metre is believed to be 1.01 m, and the heading drifts by 0.05 degrees a second."""

SUBSTEPS = 120
"""Steps of physics a second: the car moves 4 mm in one."""

RIG, BODY = StereoRig(forward=0.15), Body()
"""The car of [A], and its pair of cameras, 15 cm ahead of the middle of the body."""


class Collision(NamedTuple):
    """When the car touched something, s, and its pose, m and radians."""

    time: float
    x: float
    y: float
    heading: float


class CarLimits(NamedTuple):
    """What the car can do. [A] gives speed and radius; the steering is that of model-car servos, from lock to lock."""

    speed: float = 1.0  # m/s, forward and backward
    curvature: float = 2.2  # 1/m
    acceleration: float = 2.5  # m/s^2, also when braking
    steering: float = 8.0  # change of the curvature, 1/m a second

    @classmethod
    def of(cls, body: Body) -> CarLimits:
        """Of a robot with this body, which steers from lock to lock in the time of the car of [A]."""
        if body == BODY:
            return cls()
        tightest, usual = body.max_curvature_per_m, cls()
        steering = tightest * usual.steering / usual.curvature
        return cls(body.max_speed_m_per_s, tightest, body.max_acceleration_m_per_s2, steering)


class SimulatedCar:
    """Where the car is and what it does. Pose: x, y in m and heading in radians of the middle of its body.

    Commands take effect after `delay` seconds.
    """

    def __init__(self, limits: CarLimits | None = None, delay: float = 0.0) -> None:
        self.limits, self.delay = limits or CarLimits(), delay
        self.queue: deque[tuple[float, DriveCommand]] = deque()
        self.place(0.0, 0.0, 0.0)

    def place(self, x: float, y: float, heading: float) -> None:
        """Move the car there; it is stationary."""
        self.x, self.y, self.heading = x, y, heading
        self.speed = self.curvature = self.length = self.turned = self.seconds = 0.0
        self.wanted = STAND

    def send(self, command: DriveCommand, now: float = 0.0) -> DriveCommand:
        within = DriveCommand(*(min(max(v, -m), m) for v, m in zip(command, self.limits[:2], strict=True)))
        if self.delay:
            self.queue.append((now + self.delay, within))
        else:
            self.wanted = within
        return within

    def stop(self) -> None:
        self.queue.clear()
        self.wanted, self.speed = STAND, 0.0

    def advance(self, dt: float, now: float = 0.0) -> None:
        """Drive for `dt` seconds, until `now`: the exact arc at the speed and curvature reached by then."""
        while self.queue and self.queue[0][0] <= now + 1e-9:
            self.wanted = self.queue.popleft()[1]
        faster, tighter = self.limits.acceleration * dt, self.limits.steering * dt
        self.speed += min(max(self.wanted.speed - self.speed, -faster), faster)
        self.curvature += min(max(self.wanted.curvature - self.curvature, -tighter), tighter)
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
        speed = self.length / self.seconds if self.seconds else 0.0
        curvature = self.turned / self.length if abs(self.length) > 1e-9 else 0.0
        self.length = self.turned = self.seconds = 0.0
        return DriveCommand(speed, curvature)


REACH = (0.02, 60.0)
"""Nearest and farthest distance that is rendered, m."""


class Cameras:
    """Renders what the cameras of a rig see from a pose; the pixels of a strip equal those of the frame to the bit."""

    def __init__(
        self,
        world: World,
        rig: StereoRig,
        fields: tuple[Rect, Rect] | None = None,
        full_frames: bool = False,
        disturbances: Disturbances | None = None,
    ) -> None:
        self.world, self.rig, self.full_frames = world, rig, full_frames
        self.errors = disturbances or Disturbances()
        self.fields = fields or rig.subfields()
        self.strips = tuple((field, row_rect(rig)) for field in self.fields)

    def look(self, x: float, y: float, heading: float) -> list[torch.Tensor | Strips]:
        """What the left and the right camera see with the car there: frames `[1, 3, H, W]` uint8, or `Strips`."""
        views = [self.view(x, y, heading, side) for side in (0, 1)]
        if self.full_frames:
            return [torch.from_numpy(self.frame(view))[None] for view in views]
        pieces = iter(self.render(views, self.strips))
        return [Strips(*(torch.from_numpy(next(pieces))[None] for _ in rects)) for rects in self.strips]

    def render(self, views: Sequence[Floats], rects: Sequence[Sequence[Rect]]) -> list[Image]:
        """The pixels of rectangles of each view, `[3, h, w]`, the colors of a pixel next to each other in memory."""
        parts, begins, size, w = [], [], 0, self.world
        for number, some in enumerate(rects):
            for rect in some:
                high, wide = rect.bottom - rect.top, rect.right - rect.left
                parts.append([number, *rect, size])
                begins.append((size, high, wide))
                size += high * wide
        cameras, out = np.array(views), np.empty((size, 3), np.uint8)
        rasterise(w.corners, w.surface, w.texels, w.mipmaps, cameras, np.array(parts), REACH, out)
        return [out[n : n + high * wide].reshape(high, wide, 3).transpose(2, 0, 1) for n, high, wide in begins]

    def frame(self, view: Floats) -> Image:
        return self.render([view], [[Rect(0, self.rig.height, 0, self.rig.width)]])[0]

    def view(self, x: float, y: float, heading: float, side: int) -> Floats:
        """A camera, 0 the left one, 1 the right one, as the kernel `visible_triangles` takes it, `[4, 3]`."""
        e, rig = self.errors, self.rig
        ahead, left = direction(heading), direction(heading + math.pi / 2)
        aside = (0.5 - side) * rig.baseline * (1 + e.baseline_error_ratio)
        position = np.array([x, y, rig.camera_height]) + rig.forward * ahead + aside * left
        yaw, roll = heading + math.radians(e.yaw_deg + side * e.right_yaw_deg), math.radians(e.roll_deg)
        pitch, vertical = rig.pitch + math.radians(e.pitch_deg), np.array([0.0, 0.0, 1.0])
        ahead, left = direction(yaw), direction(yaw + math.pi / 2)
        upward = math.sin(pitch) * ahead + math.cos(pitch) * vertical
        forward = math.cos(pitch) * ahead - math.sin(pitch) * vertical
        upward = math.cos(roll) * upward - math.sin(roll) * left
        focal, (column, row) = rig.focal * (1 + e.focal_error_ratio), rig.center
        across = focal * np.cross(forward, upward) + column * forward
        return np.stack((position, across, row * forward - focal * upward, forward))


def direction(angle: float) -> Floats:
    return np.array([math.cos(angle), math.sin(angle), 0.0])


class Simulation(Drive):
    """A world with the car in it, which implements all ports of the loop.

    When the car touches anything, the collision is noted and the car respawns at the nearest free place, with the
    heading in which it can drive farthest, but at another one where it came less than its length away from that. Only
    an evaluation may ask for `pose`.

    Args:
        seed: what the building looks like, and where the car starts.
        odometry: what `driven` returns, exact or `"noisy"`.
        full_frames: render whole frames instead of strips.
        fields: the subfields to render; `rig.subfields()` by default.
        rate: frames a second of the cameras.

    Raises:
        InputError: a plan where the robot does not fit.
    """

    def __init__(
        self,
        plan: Plan,
        seed: int = 0,
        *,
        odometry: Odometry = "true",
        full_frames: bool = False,
        rig: StereoRig = RIG,
        fields: tuple[Rect, Rect] | None = None,
        disturbances: Disturbances | None = None,
        rate: float = 30.0,
        body: Body = BODY,
    ) -> None:
        self.plan, self.rig, self.odometry = plan, rig, odometry
        self.disturbances, self.rate, self.body = disturbances or Disturbances(), rate, body
        self.half = np.array([body.length_m, body.width_m]) / 2
        self.world = build(plan, seed, rig, body)
        self.cameras = Cameras(self.world, rig, fields, full_frames, self.disturbances)
        self.begin(seed)

    def begin(self, seed: int) -> None:
        """Begin a drive in the same building. The seed draws the start and all chance."""
        rng = np.random.default_rng((seed, 200))
        self.effects = Effects(self.disturbances, np.random.default_rng((seed, 300)))
        # The steering takes what the car of [A] needs to react.
        delay = self.disturbances.delay_s + max(0.0, self.body.reaction_s - BODY.reaction_s)
        self.car = SimulatedCar(CarLimits.of(self.body), delay)
        self.steps = 0
        self.collisions: list[Collision] = []
        self.placed: Placed = None
        self.unfit: set[tuple[float, float]] = set()  # places where the car was put in vain
        start = self.plan.start or self.spawn_points.random(rng)
        self.place(*start)

    @cached_property
    def spawn_points(self) -> SpawnPoints:
        """Where the car fits; computed on first use, which takes seconds in a plan of thousands of walls."""
        return SpawnPoints(self.plan, self.body.unit_m)

    @property
    def pose(self) -> tuple[float, float, float]:
        """The true x, y, m, and heading, radians."""
        return self.car.x, self.car.y, self.car.heading

    def now(self) -> float:
        return self.steps / SUBSTEPS

    def wait_until(self, time: float) -> None:
        while self.steps < round(time * SUBSTEPS):
            self.steps += 1
            self.car.advance(1 / SUBSTEPS, self.now())
            if self.touches():
                self.collisions.append(Collision(self.now(), *self.pose))
                self.respawn()

    def touches(self) -> bool:
        return bool(rectangle_touches(*self.pose, self.half, self.world.walls, self.world.posts))

    def respawn(self) -> None:
        """Put the car at the nearest free place where it was not put before in vain, as long as there is one."""
        if math.dist(self.put, self.pose[:2]) < self.body.length_m:
            self.unfit.add(self.put)
        for unfit in (self.unfit, set()):
            for pose in self.spawn_points.by_distance(self.car.x, self.car.y):
                if pose[:2] not in unfit:
                    self.place(*pose)
                    if not self.touches():
                        return

    def place(self, x: float, y: float, heading: float) -> None:
        """Put the car somewhere; `take_placed` returns the pose once."""
        self.car.place(x, y, heading)
        self.placed, self.put = (x, y, heading), (x, y)

    def take_placed(self) -> Placed:
        placed, self.placed = self.placed, None
        return placed

    def read(self, wait: Callable[[float], None] | None = None) -> StereoFrames:
        """What both cameras see now, or with the next frame that is not lost; `wait` moves the world on."""
        while self.effects.loses_frame():
            (wait or self.wait_until)(self.now() + 1 / self.rate)
        now = self.now()
        left, right = (
            Strips(*(self.effects.image(part, now) for part in frame))
            if isinstance(frame, Strips)
            else self.effects.image(frame, now)
            for frame in self.cameras.look(*self.pose)
        )
        return self.effects.deliver(StereoFrames(left, right, now))

    def send(self, command: SafeCommand) -> DriveCommand:
        return self.obey(unseal(command))

    def obey(self, command: DriveCommand) -> DriveCommand:
        """Drive like this after the delay of the car; returns what it will do."""
        return self.car.send(command, self.now())

    def resume(self) -> bool:
        return True

    def stop(self) -> None:
        self.car.stop()

    def driven(self) -> DriveCommand:
        speed, curvature = self.effects.odometry(self.car.driven(), self.now())
        if self.odometry == "noisy" and speed != 0:
            speed, curvature = speed * (1 + SCALE_ERROR), (curvature + DRIFT / speed) / (1 + SCALE_ERROR)
        return DriveCommand(speed, curvature)

    def cameras_and_clock(self) -> tuple[CameraPair, Clock]:
        return self, self
