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

LIMITS_CM, UNKNOWN = (5, 700), 65535
"""Least and largest distance that are reported, cm, and that of a sector of which nothing is known."""


class MavlinkBridge(Bridge):
    """Sends obstacles in the frame of the body, and dead reckoning, at every step.

    Its connection is that of the link where that is MAVLink, too, and the table names no other device.
    """

    def __init__(self, settings: MavlinkSettings, opening: Opening) -> None:
        drive, self.navigator, self.resets = opening.drive, opening.runner.navigator, 0
        self.shared = isinstance(drive, MavlinkDrive) and "device" not in settings.model_fields_set
        shared = drive.connection if isinstance(drive, MavlinkDrive) and self.shared else None
        self.connection = shared or MavlinkConnection(settings)
        super().__init__("mavlink", opening.report)

    def handle(self, item: Step) -> None:
        step, d = item, self.connection.dialect
        if step.state is None:
            return
        stamp, seen = int(step.time * 1e6) % 2**63, seen_obstacles(step.state, self.navigator)
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

    def finish(self) -> None:
        if not self.shared:
            self.connection.close()


@bridge("mavlink")
def open_mavlink(settings: MavlinkSettings, opening: Opening) -> MavlinkBridge:
    return MavlinkBridge(settings, opening)
