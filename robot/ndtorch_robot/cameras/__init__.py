"""Two USB cameras, or files and streams in their place: opening, reading in threads, pairing by time."""

from ndtorch_robot.cameras.pair import CamerasSilent, Frame, FramesEnded, Pair, Pairing, StereoCameras, open_cameras
from ndtorch_robot.cameras.source import CameraSettings, Capture, Source, camera_source, find_source, open_capture
from ndtorch_robot.cameras.sources.v4l2 import Device, list_devices

__all__ = [
    "CameraSettings",
    "CamerasSilent",
    "Capture",
    "Device",
    "Frame",
    "FramesEnded",
    "Pair",
    "Pairing",
    "Source",
    "StereoCameras",
    "camera_source",
    "find_source",
    "list_devices",
    "open_cameras",
    "open_capture",
]
