"""MAVLink: OBSTACLE_DISTANCE and ODOMETRY for an autopilot or a ground station."""

from __future__ import annotations

import math
from typing import Any

from ndtorch_robot.bridges import Bridge, Opening, bridge
from ndtorch_robot.link.mavlink import MavlinkConnection, MavlinkSettings
from ndtorch_robot.obstacles import nearest_by_sector, seen_obstacles
from ndtorch_robot.ports import Step

SECTORS = 72
"""Distances in an OBSTACLE_DISTANCE, 5 degrees each."""

LIMITS_CM = (5, 700)
"""Least and largest distance that are reported, cm."""

UNKNOWN = 65535
"""Distance of a sector of which nothing is known."""


class MavlinkBridge(Bridge):
    """Sends obstacles in the frame of the body, and dead reckoning, at every step."""

    def __init__(self, settings: MavlinkSettings, opening: Opening) -> None:
        self.opening, self.resets = opening, 0
        self.connection = MavlinkConnection.open(settings)

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
        self.connection.close()


@bridge("mavlink")
def open_mavlink(settings: MavlinkSettings, opening: Opening) -> MavlinkBridge:
    """A bridge on the connection of the link where that is of the same kind, unless it names another device."""
    shared = {key: opening.link[key] for key in MavlinkSettings.model_fields if key in opening.link}
    shared = shared if opening.link.get("kind") == "mavlink" else {}
    return MavlinkBridge(MavlinkSettings(**shared | settings.model_dump(exclude_unset=True)), opening)
