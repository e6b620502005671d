"""A video file, or a stream: an address with `://`, or a named pipe."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from ndtorch.errors import InputError
from ndtorch.scenes.readers import open_address, open_capture, quiet_opencv
from ndtorch_robot.cameras.source import CameraSettings, Capture, Source, camera_source


def stream_address(name: str) -> str | None:
    path = Path(name)
    return name if "://" in name or (path.exists() and stat.S_ISFIFO(path.stat().st_mode)) else None


def video_path(name: str) -> str | None:
    return name if Path(name).is_file() else None


@camera_source("stream", stream_address, live=True)
def open_stream(camera: Source, settings: CameraSettings) -> Capture:
    return open_video(camera, "a stream that answers")


@camera_source("file", video_path)
def open_file(camera: Source, settings: CameraSettings) -> Capture:
    if not os.access(camera.target, os.R_OK):
        raise InputError(f"camera {camera.name}: no permission to read this file")
    return open_video(camera, "a video")


def open_video(camera: Source, wanted: str) -> Capture:
    with quiet_opencv():
        opened = open_address if "://" in camera.target else open_capture
        capture: Capture | None = opened(camera.target)
    if capture is None:
        raise InputError(f"camera {camera.name}: cannot be opened, it is not {wanted}")
    return capture
