"""Files in place of a camera: a video, a stream (an address with `://`, or a named pipe), a folder of images."""

from __future__ import annotations

import stat
from pathlib import Path
from typing import Any

import cv2

from ndtorch.errors import InputError
from ndtorch.scenes.readers import image_files, open_capture, quiet_opencv
from ndtorch_robot.cameras.source import CameraSettings, Capture, Source, camera_source


def stream_address(name: str) -> str | None:
    path = Path(name)
    return name if "://" in name or (path.exists() and stat.S_ISFIFO(path.stat().st_mode)) else None


@camera_source("file", lambda name: name if Path(name).is_file() else None)
@camera_source("stream", stream_address, live=True)
def open_video(camera: Source, settings: CameraSettings) -> Capture:
    capture: Capture | None = open_capture(camera.target)
    if capture is None:
        wanted = "a stream that answers" if camera.live else "a video that may be read"
        raise InputError(f"camera {camera.name}: cannot be opened, it is not {wanted}")
    return capture


@camera_source("folder", lambda name: name if Path(name).is_dir() else None)
def open_folder(camera: Source, settings: CameraSettings) -> Capture:
    return FolderCapture(Path(camera.target), settings.rate_hz)


class FolderCapture:
    """The images of a folder in natural order, as a capture."""

    def __init__(self, folder: Path, rate: float) -> None:
        self.files, self.rate, self.next = image_files(folder), rate, 0

    def grab(self) -> bool:
        self.next += 1
        return self.next <= len(self.files)

    def retrieve(self) -> tuple[bool, Any]:
        with quiet_opencv():
            image = cv2.imread(str(self.files[self.next - 1]), cv2.IMREAD_ANYCOLOR)
        return image is not None, image

    def get(self, propId: int) -> float:
        return self.rate if propId == cv2.CAP_PROP_FPS else 0.0

    def set(self, propId: int, value: float) -> bool:
        return False

    def release(self) -> None:
        """Nothing is held open."""
