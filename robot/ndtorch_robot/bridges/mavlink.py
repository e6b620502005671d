"""MAVLink: OBSTACLE_DISTANCE and ODOMETRY for an autopilot, and commands from it or a ground station."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy.typing as npt
from pydantic import Field

from ndtorch_robot.bridges.registry import Bridge, Opening, bridge, command_of
from ndtorch_robot.link.mavlink_connection import COMPONENT, MavlinkConnection, MavlinkSettings, shared_settings
from ndtorch_robot.obstacles import nearest_by_sector, seen_obstacles
from ndtorch_robot.ports import DriveCommand, Step

SECTORS = 72
"""Distances in an OBSTACLE_DISTANCE, 5 degrees each."""

LIMITS_CM = (5, 700)
"""Least and largest distance that are reported, cm."""

UNKNOWN = 65535
"""Distance of a sector of which nothing is known."""


class MavlinkBridgeSettings(MavlinkSettings):
    """`[bridges.mavlink]`; without `device` that of a `[link]` of the kind `mavlink`.

    Args:
        device, baud, system_id: as of the link.
        max_speed_m_per_s: MANUAL_CONTROL at full deflection asks for this speed.
        max_curvature_per_m: and for this curvature.
    """

    device: str = ""
    max_speed_m_per_s: Annotated[float, Field(gt=0, le=5)] = 0.5
    max_curvature_per_m: Annotated[float, Field(gt=0, le=10)] = 2.0


class MavlinkBridge(Bridge):
    """Sends what is around the car, and where it is, at every step; takes commands that are sent to us.

    Those are SET_POSITION_TARGET_LOCAL_NED in the frame of the body, and MANUAL_CONTROL of a gamepad at a ground
    station.
    """

    def __init__(self, settings: MavlinkBridgeSettings, opening: Opening) -> None:
        self.settings, self.opening = settings, opening
        self.connection = MavlinkConnection.open(settings)
        self.connection.listeners.append(self.handle)
        self.resets, self.restarted = 0, False

    def publish(self, step: Step) -> None:
        if step.state is None:
            return
        stamp = int(step.time * 1e6) % 2**63
        d = self.connection.dialect
        seen, width = seen_obstacles(step.state, self.opening.runner.navigator), 360 // SECTORS
        about = (stamp, d.MAV_DISTANCE_SENSOR_UNKNOWN, sector_distances(seen.x, seen.y), width, *LIMITS_CM)
        self.connection.send("obstacle_distance", *about, width, 0.0, d.MAV_FRAME_BODY_FRD)
        self.resets = (self.resets + (step.restarted or step.placed is not None)) % 256
        self.connection.send("odometry", *odometry(step, stamp, d, self.resets))

    def handle(self, message: Any) -> None:
        """What the reading thread of the connection has heard."""
        kind, most, wish = message.get_type(), self.settings, self.opening.wish
        if wish is None or getattr(message, "target_component", COMPONENT) != COMPONENT:
            return
        if kind == "MANUAL_CONTROL":
            speed, turn = most.max_speed_m_per_s * message.x / 1000, -message.r / 1000
            wish.put(DriveCommand(speed, most.max_curvature_per_m * turn))
        elif kind == "SET_POSITION_TARGET_LOCAL_NED" and message.coordinate_frame == 8:
            wish.put(command_of(message.vx, -message.yaw_rate))

    def close(self) -> None:
        self.connection.listeners.remove(self.handle)
        self.connection.close()


def sector_distances(x: npt.NDArray[Any], y: npt.NDArray[Any]) -> list[int]:
    """Distances of an OBSTACLE_DISTANCE, cm, clockwise from ahead, of obstacles in the frame of the body, m (y to the
    left).
    """
    near = nearest_by_sector(x, -y, SECTORS)
    return [UNKNOWN if math.isinf(distance) else min(round(100 * distance), UNKNOWN - 1) for distance in near.tolist()]


def odometry(step: Step, stamp: int, dialect: Any, resets: int) -> tuple[Any, ...]:
    """The fields of an ODOMETRY: y and z are turned over, because MAVLink has y to the right and z down."""
    assert step.state is not None
    pose, driven = step.state.pose, step.driven
    x, y, yaw = float(pose.x), -float(pose.y), -float(pose.heading)
    turn = -driven.speed * driven.curvature
    unknown = [math.nan] + [0.0] * 20
    frames = dialect.MAV_FRAME_LOCAL_FRD, dialect.MAV_FRAME_BODY_FRD
    attitude = [math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)]
    moves = (driven.speed, 0.0, 0.0, 0.0, 0.0, turn)
    return (stamp, *frames, x, y, 0.0, attitude, *moves, unknown, unknown, resets, dialect.MAV_ESTIMATOR_TYPE_VISION)


@bridge("mavlink", MavlinkBridgeSettings)
def open_mavlink(settings: MavlinkBridgeSettings, opening: Opening) -> MavlinkBridge:
    told = shared_settings(settings.model_dump(exclude_unset=True), opening.link)
    return MavlinkBridge(MavlinkBridgeSettings(**told), opening)
