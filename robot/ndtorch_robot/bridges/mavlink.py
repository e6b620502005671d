"""MAVLink: OBSTACLE_DISTANCE and ODOMETRY for an autopilot or a ground station."""

from __future__ import annotations

import math
from typing import Any

from ndtorch_robot.bridges import Bridge, Opening, bridge
from ndtorch_robot.link.mavlink import MavlinkConnection, MavlinkDrive, MavlinkSettings
from ndtorch_robot.navigator_runner import nearest_by_sector, seen_obstacles
from ndtorch_robot.ports import Step

SECTORS = 72
"""Distances in an OBSTACLE_DISTANCE, 5 degrees each."""

LIMITS_CM = (5, 700)
"""Least and largest distance that are reported, cm."""

UNKNOWN = 65535
"""Distance of a sector of which nothing is known."""


class MavlinkBridge(Bridge):
    """Sends obstacles in the frame of the body, and dead reckoning, at every step."""

    def __init__(self, connection: MavlinkConnection, opening: Opening, shared: bool) -> None:
        self.connection, self.opening, self.shared, self.resets = connection, opening, shared, 0

    def publish(self, step: Step) -> None:
        if step.state is None:
            return
        d, stamp = self.connection.dialect, int(step.time * 1e6) % 2**63
        seen = seen_obstacles(step.state, self.opening.runner.navigator)
        # Clockwise from ahead: y is to the right in MAVLink.
        near = nearest_by_sector(seen.x, -seen.y, SECTORS).tolist()
        cm = [UNKNOWN if math.isinf(distance) else min(round(100 * distance), UNKNOWN - 1) for distance in near]
        about = (stamp, d.MAV_DISTANCE_SENSOR_UNKNOWN, cm, 360 // SECTORS, *LIMITS_CM)
        self.connection.send("obstacle_distance", *about, 360 // SECTORS, 0.0, d.MAV_FRAME_BODY_FRD)
        self.resets = (self.resets + (step.restarted or step.placed is not None)) % 256
        pose, driven = step.state.pose, step.driven
        x, y, yaw = float(pose.x), -float(pose.y), -float(pose.heading)
        attitude = [math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)]
        motion = (driven.speed, 0.0, 0.0, 0.0, 0.0, -driven.speed * driven.curvature)
        unknown: list[Any] = [math.nan] + [0.0] * 20
        frames = d.MAV_FRAME_LOCAL_FRD, d.MAV_FRAME_BODY_FRD
        after = (unknown, unknown, self.resets, d.MAV_ESTIMATOR_TYPE_VISION)
        self.connection.send("odometry", stamp, *frames, x, y, 0.0, attitude, *motion, *after)

    def close(self) -> None:
        if not self.shared:
            self.connection.close()


@bridge("mavlink")
def open_mavlink(settings: MavlinkSettings, opening: Opening) -> MavlinkBridge:
    """A bridge on the connection of the link where that is MAVLink, too, and the table names no other device."""
    if isinstance(opening.drive, MavlinkDrive) and "device" not in settings.model_fields_set:
        return MavlinkBridge(opening.drive.connection, opening, shared=True)
    return MavlinkBridge(MavlinkConnection(settings), opening, shared=False)
