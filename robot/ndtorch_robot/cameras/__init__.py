"""Two USB cameras, or files and streams in their place: opening, reading in threads, pairing by time."""

from ndtorch_robot.cameras.pair import CamerasSilent, FramesEnded, StereoCameras, open_cameras
from ndtorch_robot.cameras.pairing import Frame, Pair, Pairing, PairStatistics
from ndtorch_robot.cameras.source import CameraSettings, Capture, camera_source, find_source, open_capture
from ndtorch_robot.cameras.sources.v4l2 import Device, list_devices

__all__ = [
    "CameraSettings",
    "CamerasSilent",
    "Capture",
    "Device",
    "Frame",
    "FramesEnded",
    "Pair",
    "PairStatistics",
    "Pairing",
    "StereoCameras",
    "camera_source",
    "find_source",
    "list_devices",
    "open_cameras",
    "open_capture",
]
