"""The simulated robot in its building: cameras, drive, odometer and clock of the loop, and the collisions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from torch import Tensor

from ndtorch.navigation import Body, Rect, StereoRig, Strips
from ndtorch_robot.ports import CameraPair, Clock, Drive, DriveCommand, Placed, SafeCommand, StereoFrames, unseal
from ndtorch_robot.sim.cameras import Cameras, Frame, Motion
from ndtorch_robot.sim.car import Car, CarLimits
from ndtorch_robot.sim.disturbances import Disturbances
from ndtorch_robot.sim.disturbances.actuators import Delay
from ndtorch_robot.sim.model import build
from ndtorch_robot.sim.plan import Plan, Point
from ndtorch_robot.sim.procedural_textures import Walls
from ndtorch_robot.sim.spawn_points import SpawnPoints

Odometry = Literal["true", "noisy"]

SCALE_ERROR, DRIFT = 0.01, math.radians(0.05)
"""Noisy odometry: every metre is believed to be 1.01 m, and the heading drifts by 0.05 degrees a second."""

SUBSTEPS = 120
"""Steps of physics a second: the car moves 4 mm in one."""

WALK = 0.4
"""Speed of the pedestrian, m/s."""

RIG = StereoRig(forward=0.15)
"""The cameras of the robot: the pair of [A], 15 cm ahead of the middle of the body."""

BODY = Body()
"""The car of [A]."""

UNDISTURBED = Disturbances()

STATIONARY = 0.02
"""m/s: a car slower than this is stationary."""


class Mover(NamedTuple):
    """A cylinder that moves to and fro along a path.

    Attributes:
        points: of the path, m, at equal distances.
        speed: m/s.
        begins: distance along the path at time 0, m; it may lie beyond an end.
    """

    points: tuple[Point, ...]
    speed: float
    begins: float

    def at(self, time: float) -> Point:
        """Where it is at a time, s."""
        points = np.array(self.points)
        step = math.dist(*self.points[:2])
        last = len(points) - 1
        way = (self.begins + self.speed * time) / step % (2 * last)
        x, y = (np.interp(min(way, 2 * last - way), np.arange(last + 1), axis) for axis in points.T)
        return float(x), float(y)


class Collision(NamedTuple):
    """When and where the car touched something.

    Attributes:
        time: s.
        x, y, heading: of the car, m and radians.
        person: it was the pedestrian, or another body that moves.
        stationary: the car was stationary, so that the other one hit it.
    """

    time: float
    x: float
    y: float
    heading: float
    person: bool = False
    stationary: bool = False


class Simulation(Drive):
    """A world with the car in it, which implements all ports of the loop.

    When the car touches anything, the collision is noted and the car respawns at the nearest free place, with the
    heading in which it can drive farthest. Only an evaluation may ask for `pose`.

    Args:
        plan: the building.
        seed: what it looks like, where the car starts and the pedestrian walks.
        walls: `"textured"` or `"blank"`.
        pedestrian: a person-sized box walks to and fro.
        odometry: what `driven` returns, exact or `"noisy"`.
        full_frames: render whole frames instead of strips.
        fields: the subfields to render; `rig.subfields()` by default.
        disturbances: of cameras and car.
        rate: frames a second of the cameras.
        body: of the robot.
        movers: cylinders that move.
        plain_cylinders: they are in plain coarse checks instead of the texture of pillars.

    Raises:
        InputError: a plan where the robot does not fit.
    """

    def __init__(
        self,
        plan: Plan,
        seed: int = 0,
        *,
        walls: Walls = "textured",
        pedestrian: bool = False,
        odometry: Odometry = "true",
        full_frames: bool = False,
        rig: StereoRig = RIG,
        fields: tuple[Rect, Rect] | None = None,
        disturbances: Disturbances = UNDISTURBED,
        rate: float = 30.0,
        body: Body = BODY,
        movers: Sequence[Mover] = (),
        plain_cylinders: bool = False,
    ) -> None:
        import mujoco

        self.plan, self.rig, self.odometry, self.pedestrian = plan, rig, odometry, pedestrian
        self.disturbances, self.rate, self.body = disturbances, rate, body
        self.movers = tuple(movers)
        self.world = build(plan, seed, walls, pedestrian, rig, body, len(self.movers), plain_cylinders)
        self.data = mujoco.MjData(self.world.model)
        self.begin(seed)
        self.cameras = Cameras(self.world.model, rig, fields, full_frames, disturbances.camera())

    def begin(self, seed: int) -> None:
        """Begin a drive in the same building. The seed draws the start, the path of the pedestrian and all chance."""
        rng = np.random.default_rng((seed, 200))
        errors = self.disturbances.car()
        self.effects = self.disturbances.start(np.random.default_rng((seed, 300)))
        # The steering takes what the car of [A] needs to react.
        self.delay = Delay(errors.delay + max(0.0, self.body.reaction_s - BODY.reaction_s))
        self.car = Car(CarLimits.of(self.body), errors.backlash)
        self.steps = 0
        self.collisions: list[Collision] = []
        self.placed: Placed = None
        start = self.plan.start or self.spawn_points.random(rng)
        self.walk = self.spawn_points.walk(rng, (start[0], start[1])) if self.pedestrian else None
        self.move_bodies()
        self.place(*start)

    @cached_property
    def spawn_points(self) -> SpawnPoints:
        """Where the car fits; computed on first use, which takes seconds in a plan of thousands of walls."""
        return SpawnPoints(self.plan, self.body.unit_m)

    @property
    def pose(self) -> tuple[float, float, float]:
        """The true x, y, m, and heading, radians."""
        return self.car.x, self.car.y, self.car.heading

    @property
    def pedestrian_at(self) -> tuple[float, float] | None:
        if self.walk is None:
            return None
        (ax, ay), (bx, by) = self.walk
        length = math.hypot(bx - ax, by - ay)
        phase = (self.now() * WALK / length) % 2.0
        share = phase if phase <= 1 else 2 - phase
        return ax + share * (bx - ax), ay + share * (by - ay)

    def now(self) -> float:
        return self.steps / SUBSTEPS

    def wait_until(self, time: float) -> None:
        while self.steps < round(time * SUBSTEPS):
            self.steps += 1
            arrived = self.delay.take(self.now())
            if arrived is not None:
                self.car.send(arrived)
            self.car.advance(1 / SUBSTEPS)
            self.move_bodies()
            if self.touches():
                stationary = abs(self.car.speed) < STATIONARY
                self.collisions.append(Collision(self.now(), *self.pose, self.touches_moving(), stationary))
                self.respawn()

    def move_bodies(self) -> None:
        person, now = self.pedestrian_at, self.now()
        places = [mover.at(now) for mover in self.movers]
        for k, place in enumerate(places if person is None else [person, *places]):
            self.data.mocap_pos[k] = [*place, 0.0]

    def touches(self, pose: tuple[float, float, float] | None = None) -> bool:
        """Whether the car would touch anything at a pose, by default its own."""
        import mujoco

        self.data.qpos[:] = self.pose if pose is None else pose
        mujoco.mj_kinematics(self.world.model, self.data)
        mujoco.mj_comPos(self.world.model, self.data)
        mujoco.mj_collision(self.world.model, self.data)
        return bool(self.data.ncon > 0)

    def touches_moving(self) -> bool:
        bodies = self.world.model.geom_bodyid
        mocap = self.world.model.body_mocapid
        pairs = (self.data.contact.geom1[: self.data.ncon], self.data.contact.geom2[: self.data.ncon])
        return any(bool((mocap[bodies[geoms]] >= 0).any()) for geoms in pairs)

    def respawn(self) -> None:
        """Move the car to the nearest free place, away from the pedestrian, where it touches nothing."""
        for place in self.spawn_points.by_distance(self.car.x, self.car.y, self.pedestrian_at):
            self.place(*place)
            if not self.touches():
                return

    def place(self, x: float, y: float, heading: float) -> None:
        """Put the car somewhere; `take_placed` returns the pose once."""
        self.car.place(x, y, heading)
        self.placed = (x, y, heading)
        self.touches()

    def take_placed(self) -> Placed:
        """The pose to which the car was moved since the last call, or None."""
        placed, self.placed = self.placed, None
        return placed

    def read(self) -> StereoFrames:
        """What both cameras see now, or with the next frame that is not lost."""
        while self.loses_frame():
            self.wait_until(self.now() + 1 / self.rate)
        return self.capture()

    def loses_frame(self) -> bool:
        """Whether this frame never arrives; to be asked once a frame before `capture`, as `read` does."""
        return any(effect.loses_frame() for effect in self.effects)

    def capture(self) -> StereoFrames:
        """The frames that arrive now."""
        now = self.now()
        seen = self.cameras.look(self.data, *self.pose, Motion(self.car.speed, self.car.curvature))
        left, right = (self.sensed(frame, side, now) for side, frame in enumerate(seen))
        frames = StereoFrames(left, right, now)
        for effect in self.effects:
            frames = effect.deliver(frames)
        return frames

    def sensed(self, frame: Frame, side: int, time: float) -> Frame:
        if not self.effects:
            return frame
        if not isinstance(frame, Strips):
            return self.sensed_part(frame, 0, time)
        tops = (rect.top for rect in self.cameras.strips[side])
        return Strips(*(self.sensed_part(part, top, time) for part, top in zip(frame, tops, strict=True)))

    def sensed_part(self, pixels: Tensor, top: int, time: float) -> Tensor:
        """Rows of a frame, the first of which is `top`, as the sensor gives them."""
        rows = top + np.arange(pixels.shape[-2], dtype=np.float64)
        row_times = time + self.cameras.errors.readout * (rows / self.rig.height - 0.5)
        for effect in self.effects:
            pixels = effect.image(pixels, time, row_times)
        return pixels

    def send(self, command: SafeCommand) -> DriveCommand:
        """Drive like this from now on."""
        return self.obey(unseal(command))

    def obey(self, command: DriveCommand) -> DriveCommand:
        """Drive like this after the delay of the car; returns what it will do."""
        if not self.delay.seconds:
            return self.car.send(command)
        will_do = self.car.within(command)
        self.delay.put(will_do, self.now())
        return will_do

    def resume(self) -> bool:
        """Nothing to do: this drive obeys at once after a stop."""
        return True

    def stop(self) -> None:
        self.delay.clear()
        self.car.send(DriveCommand(0.0, 0.0))
        self.car.speed = 0.0

    def driven(self) -> DriveCommand:
        """What the wheels say they did since this was last asked."""
        driven = self.car.driven()
        for effect in self.effects:
            driven = effect.odometry(driven, self.now())
        speed, curvature = driven
        if self.odometry == "noisy" and speed != 0:
            return DriveCommand(speed * (1 + SCALE_ERROR), (curvature + DRIFT / speed) / (1 + SCALE_ERROR))
        return driven

    def cameras_and_clock(self) -> tuple[CameraPair, Clock]:
        return self, self

    def close(self) -> None:
        self.cameras.close()
