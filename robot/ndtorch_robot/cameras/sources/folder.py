"""A folder of images in place of a camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ndtorch.scenes.image_folder import FolderReader
from ndtorch.scenes.readers import quiet_opencv
from ndtorch_robot.cameras.source import CameraSettings, Capture, Source, camera_source


def folder_path(name: str) -> str | None:
    return name if Path(name).is_dir() else None


@camera_source("folder", folder_path)
def open_folder(camera: Source, settings: CameraSettings) -> Capture:
    return FolderCapture(Path(camera.target), settings.rate_hz)


class FolderCapture:
    """The images of a folder in natural order, as a capture."""

    def __init__(self, folder: Path, rate: float) -> None:
        self.files, self.rate, self.next = FolderReader(folder).files, rate, 0

    def grab(self) -> bool:
        self.next += 1
        return self.next <= len(self.files)

    def retrieve(self) -> tuple[bool, Any]:
        import cv2

        with quiet_opencv():
            image = cv2.imread(str(self.files[self.next - 1]), cv2.IMREAD_ANYCOLOR)
        return image is not None, image

    def get(self, propId: int) -> float:
        import cv2

        return {cv2.CAP_PROP_FPS: self.rate, cv2.CAP_PROP_FRAME_COUNT: float(len(self.files))}.get(propId, 0.0)

    def set(self, propId: int, value: float) -> bool:
        return False

    def release(self) -> None:
        """Nothing to let go of."""
