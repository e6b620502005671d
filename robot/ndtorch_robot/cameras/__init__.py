"""Two USB cameras, or files and streams in their place: opening, reading in threads, pairing by time."""

from ndtorch_robot.cameras.opening import open_cameras
from ndtorch_robot.cameras.pair import CamerasSilent, FramesEnded, StereoCameras
from ndtorch_robot.cameras.pairing import Frame, Pair, Pairing, PairStatistics
from ndtorch_robot.cameras.settings import CameraSettings
from ndtorch_robot.cameras.source import Capture, find_source, open_capture
from ndtorch_robot.cameras.sysfs import Device, list_devices

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
    "find_source",
    "list_devices",
    "open_cameras",
    "open_capture",
]
