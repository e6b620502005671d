"""Two USB cameras, or files and streams in their place: opening, reading in threads, pairing by time."""

from ndtorch_robot.cameras.pair import CameraFrame, CamerasSilent, Pairing, StereoCameras, open_cameras
from ndtorch_robot.cameras.source import CameraSettings, find_source, list_devices, open_capture

__all__ = [
    "CameraFrame",
    "CameraSettings",
    "CamerasSilent",
    "Pairing",
    "StereoCameras",
    "find_source",
    "list_devices",
    "open_cameras",
    "open_capture",
]
