"""Bridges from the loop to other systems, such as MAVLink and ROS 2; see docs/robot/bridges.md."""

from ndtorch_robot.bridges.registry import BRIDGES, Bridge, BridgeThread, Opening, Wish, bridge, open_bridges

__all__ = ["BRIDGES", "Bridge", "BridgeThread", "Opening", "Wish", "bridge", "open_bridges"]
