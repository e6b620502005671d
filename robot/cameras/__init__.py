"""Two USB cameras, or files and streams in their place: opening, reading in threads, pairing by time."""

from robot.cameras.opening import open_cameras
from robot.cameras.pair import CamerasSilent, FramesEnded, StereoCameras
from robot.cameras.pairing import Frame, Pair, Pairing, PairStatistics
from robot.cameras.settings import CameraSettings
from robot.cameras.source import Capture, find_source, open_capture
from robot.cameras.sysfs import Device, list_devices

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
