"""The simulated robot in its building: cameras, drive, odometer and clock of the loop, and the collisions."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Literal

import numpy as np

from ndtorch.navigation import Rect, StereoRig, Strips
from ndtorch_robot.ports import CameraPair, Clock, Drive, DriveCommand, Placed, SafeCommand, StereoFrames, unseal
from ndtorch_robot.sim.cameras import Cameras
from ndtorch_robot.sim.car import Car
from ndtorch_robot.sim.hits import STANDS, Collision
from ndtorch_robot.sim.model import build
from ndtorch_robot.sim.paint import Walls
from ndtorch_robot.sim.places import Places
from ndtorch_robot.sim.plan import Plan
from ndtorch_robot.sim.stress.actuators import Delay, Odometer
from ndtorch_robot.sim.stress.light import Light
from ndtorch_robot.sim.stress.optics import Motion
from ndtorch_robot.sim.stress.options import Stress
from ndtorch_robot.sim.stress.timing import FrameTiming

Odometry = Literal["true", "noisy"]

SCALE_ERROR, DRIFT = 0.01, math.radians(0.05)
"""Noisy odometry: every metre is believed to be 1.01 m, and the heading drifts by 0.05 degrees a second."""

SUBSTEPS = 120
"""Steps of physics a second: the car moves 4 mm in one."""

WALK = 0.4
"""Speed of the moving obstacle, m/s."""

RIG = StereoRig(forward=0.15)
"""The cameras of the robot: the pair of [A], 15 cm ahead of the middle of the body."""


class Simulation(Drive):
    """A world with the car in it. It is all ports of the loop in one.

    When the car touches anything the collision is noted and the car is put back at the nearest free place,
    where it looks down the longest way. Only the scorer may ask for `pose`.

    Args:
        plan: the building.
        seed: what it looks like, where the car starts and the obstacle walks.
        walls: `"textured"` or `"blank"`.
        moving: with a moving obstacle.
        odometry: what `driven` says, exact or `"noisy"`.
        whole: draw whole frames.
        fields: the subfields to draw; `rig.subfields()` by default.
        stress: what is wrong with cameras and car.
        rate: frames a second of the cameras.

    Raises:
        InputError: no OpenGL, or a plan where the car does not fit.
    """

    def __init__(
        self,
        plan: Plan,
        seed: int = 0,
        *,
        walls: Walls = "textured",
        moving: bool = False,
        odometry: Odometry = "true",
        whole: bool = False,
        rig: StereoRig = RIG,
        fields: tuple[Rect, Rect] | None = None,
        stress: Stress | None = None,
        rate: float = 30.0,
    ) -> None:
        import mujoco

        self.plan, self.rig, self.odometry, self.moving = plan, rig, odometry, moving
        self.stress, self.rate = stress or Stress(), rate
        self.world = build(plan, seed, walls, moving, rig.camera_height)
        self.data = mujoco.MjData(self.world.model)
        self.begin(seed)
        self.cameras = Cameras(self.world.model, rig, fields, whole=whole, stress=self.stress)

    def begin(self, seed: int) -> None:
        """Begin a drive anew in the same building: where the car starts, the obstacle walks and all chance, by seed."""
        rng, bad_luck = np.random.default_rng((seed, 200)), np.random.default_rng((seed, 300))
        self.light = Light(self.stress, bad_luck, self.rig.height)
        self.timing = FrameTiming(self.stress, bad_luck)
        self.odometer = Odometer(self.stress, bad_luck)
        self.on_the_way = Delay(self.stress.delay)
        self.car = Car(slack=self.stress.slack)
        self.steps = 0
        self.collisions: list[Collision] = []
        self.placed: Placed = None
        start = self.plan.start or self.places.any(rng)
        self.walk = self.places.walk(rng, (start[0], start[1])) if self.moving else None
        self.move_obstacle()
        self.place(*start)

    @cached_property
    def places(self) -> Places:
        """Where the car fits; found when first asked for, which takes seconds in a plan of thousands of walls."""
        return Places(self.plan)

    @property
    def pose(self) -> tuple[float, float, float]:
        """The true x, y, m, and heading, radians."""
        return self.car.x, self.car.y, self.car.heading

    @property
    def obstacle(self) -> tuple[float, float] | None:
        """Where the moving obstacle is, m."""
        if self.walk is None:
            return None
        (ax, ay), (bx, by) = self.walk
        length = math.hypot(bx - ax, by - ay)
        phase = (self.now() * WALK / length) % 2.0
        share = phase if phase <= 1 else 2 - phase
        return ax + share * (bx - ax), ay + share * (by - ay)

    def now(self) -> float:
        """Seconds of simulated time."""
        return self.steps / SUBSTEPS

    def wait_until(self, time: float) -> None:
        """Let the world move on."""
        while self.steps < round(time * SUBSTEPS):
            self.steps += 1
            arrived = self.on_the_way.take(self.now())
            if arrived is not None:
                self.car.send(arrived)
            self.car.advance(1 / SUBSTEPS)
            self.move_obstacle()
            if self.touches():
                standing = abs(self.car.speed) < STANDS
                self.collisions.append(Collision(self.now(), *self.pose, self.touches_person(), standing))
                self.put_back()

    def move_obstacle(self) -> None:
        """Put the obstacle where it is now."""
        place = self.obstacle
        if place is not None:
            self.data.mocap_pos[0] = [*place, 0.0]

    def touches(self) -> bool:
        """Whether the physics finds the car in contact with anything."""
        import mujoco

        self.data.qpos[:] = self.pose
        mujoco.mj_kinematics(self.world.model, self.data)
        mujoco.mj_comPos(self.world.model, self.data)
        mujoco.mj_collision(self.world.model, self.data)
        return bool(self.data.ncon > 0)

    def touches_person(self) -> bool:
        """Whether it is the moving obstacle that the car was found in contact with."""
        bodies = self.world.model.geom_bodyid
        mocap = self.world.model.body_mocapid
        pairs = (self.data.contact.geom1[: self.data.ncon], self.data.contact.geom2[: self.data.ncon])
        return any(bool((mocap[bodies[geoms]] >= 0).any()) for geoms in pairs)

    def put_back(self) -> None:
        """Carry the car to the nearest free place, away from the moving obstacle, where it touches nothing."""
        for place in self.places.by_distance(self.car.x, self.car.y, self.obstacle):
            self.place(*place)
            if not self.touches():
                return

    def place(self, x: float, y: float, heading: float) -> None:
        """Put the car somewhere; `take_placed` tells once."""
        self.car.place(x, y, heading)
        self.placed = (x, y, heading)
        self.touches()

    def take_placed(self) -> Placed:
        """The pose at which the car was put since this was last asked: whoever carries it knows where to."""
        placed, self.placed = self.placed, None
        return placed

    def read(self) -> StereoFrames:
        """What both cameras see now, or with the next frame that is not lost."""
        while self.loses():
            self.wait_until(self.now() + 1 / self.rate)
        return self.picture()

    def loses(self) -> bool:
        """Whether this frame never comes. Who lets time go on asks this before `picture`, as `read` does."""
        return self.timing.loses()

    def picture(self) -> StereoFrames:
        """What both cameras give now."""
        now, tops = self.now(), [rect.top for rect in self.cameras.strips[0]]
        eyes = self.cameras.look(self.data, *self.pose, Motion(self.car.speed, self.car.curvature))
        left, right = (
            Strips(*(self.light.frame(part, top, now) for part, top in zip(eye, tops, strict=True)))
            if isinstance(eye, Strips)
            else self.light.frame(eye, 0, now)
            for eye in eyes
        )
        return self.timing.deliver(StereoFrames(left, right, now))

    def send(self, command: SafeCommand) -> DriveCommand:
        """Drive like this from now on."""
        return self.obey(unseal(command))

    def obey(self, command: DriveCommand) -> DriveCommand:
        """Drive like this, as soon as the car does what it is told; returns what it will do."""
        if not self.stress.delay:
            return self.car.send(command)
        will_do = self.car.within(command)
        self.on_the_way.put(will_do, self.now())
        return will_do

    def resume(self) -> bool:
        """Nothing to do: this drive obeys at once after a stop."""
        return True

    def stop(self) -> None:
        """Stand still at once."""
        self.on_the_way.clear()
        self.car.send(DriveCommand(0.0, 0.0))
        self.car.speed = 0.0

    def driven(self) -> DriveCommand:
        """What the wheels say they did since this was last asked."""
        speed, curvature = self.odometer.says(self.car.driven(), self.now())
        if self.odometry == "noisy" and speed != 0:
            return DriveCommand(speed * (1 + SCALE_ERROR), (curvature + DRIFT / speed) / (1 + SCALE_ERROR))
        return DriveCommand(speed, curvature)

    def sight(self) -> tuple[CameraPair, Clock]:
        """Its own cameras and its own time."""
        return self, self

    def close(self) -> None:
        """Give the buffers back."""
        self.cameras.close()
