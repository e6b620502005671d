"""The settings of the cameras, and the registry of what can stand in for one: devices, files, folders, streams.

A kind of source is one file in `sources/`, or anywhere in a program of one's own: a function that opens it, with
`@camera_source` before it.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Protocol

import numpy as np
from pydantic import ConfigDict, Field

from ndtorch.errors import InputError
from ndtorch.utils.toml import Strict

Image = np.ndarray[Any, np.dtype[np.uint8]]
"""`[H, W, 3]` in blue, green, red, or `[H, W]` in grey."""


class CameraSettings(Strict):
    """`[cameras]` of a car's file."""

    model_config = ConfigDict(use_attribute_docstrings=True)

    left: Annotated[str, Field(min_length=1)]
    """Left camera: a device (/dev/v4l/by-path/..., /dev/video0 or a number), video file, folder of images, or address
    with ://."""
    right: Annotated[str, Field(min_length=1)]
    """Right camera, named like the left one."""
    width_px: int = Field(640, ge=16, le=8192)
    """Width of a frame, in pixels."""
    height_px: int = Field(480, ge=16, le=8192)
    """Height of a frame, in pixels."""
    rate_hz: float = Field(30.0, gt=0, le=1000)
    """Frame rate that is requested, and at which folders play, in Hz."""
    fourcc: str = Field("MJPG", pattern=r"^[ -~]{4}$")
    """Pixel format that is requested; with MJPG two cameras fit on a USB 2 bus, with YUYV hardly ever."""
    exposure_ms: Annotated[float, Field(gt=0, le=1000)] | None = 10.0
    """Fixed exposure, in ms; 10 ms hides the flicker of lamps on 50 Hz mains, and without a value it is automatic."""
    gain: Annotated[float, Field(ge=0)] | None = None
    """Fixed gain, in units of the driver; without one the camera keeps its own."""
    tolerance_ms: float = Field(16.0, gt=0, le=1000)
    """Largest difference in time of the two frames of a pair, in ms."""
    max_age_ms: float = Field(100.0, gt=0, le=10000)
    """Longest wait for a pair, and largest age of one, in ms."""
    calibration: Path | None = None
    """File of `ndtorch calibrate`, OpenCV, Kalibr or KITTI by which frames are rectified; by default they are not."""


class Capture(Protocol):
    """The part of `cv2.VideoCapture` that is used."""

    def grab(self) -> bool:
        """Wait for the next frame; False when there is none."""
        ...

    def retrieve(self) -> tuple[bool, Any]:
        """Decode the frame that was grabbed: `Image`, or nothing."""
        ...

    def get(self, propId: int) -> float: ...

    def set(self, propId: int, value: float) -> bool: ...

    def release(self) -> None: ...


class Source(NamedTuple):
    """Where frames come from.

    Attributes:
        kind: name of its kind.
        name: as the user wrote it.
        target: path or address to open.
        live: whether frames come by themselves.
    """

    kind: str
    name: str
    target: str
    live: bool


Opener = Callable[[Source, CameraSettings], Capture]


class Kind(NamedTuple):
    """A kind of source: what it makes of a name (the target, or None), whether it is live, and what opens it."""

    target: Callable[[str], str | None]
    live: bool
    open: Opener


KINDS: dict[str, Kind] = {}


def camera_source(kind: str, target: Callable[[str], str | None], live: bool = False) -> Callable[[Opener], Opener]:
    """Decorator: this function opens sources of that kind.

    Args:
        kind: a new name.
        target: gives the path or address to open for the name of a source of this kind, and None for any other name.
        live: frames come by themselves.

    Raises:
        InputError: a name that is taken.
    """

    def register(open_: Opener) -> Opener:
        if kind in KINDS:
            raise InputError(f"there is a camera source of the kind {kind!r} already")
        KINDS[kind] = Kind(target, live, open_)
        return open_

    return register


def find_source(name: str) -> Source:
    """The source that a name means; kinds of one's own are asked first.

    Raises:
        InputError: there is no such thing.
    """
    folder = Path(__file__).parent / "sources"
    for module in pkgutil.iter_modules([str(folder)]):
        importlib.import_module(f"ndtorch_robot.cameras.sources.{module.name}")
    for kind, found in sorted(KINDS.items(), key=lambda item: item[1].open.__module__.startswith("ndtorch_robot.")):
        target = found.target(name)
        if target is not None:
            return Source(kind, name, target, found.live)
    raise InputError(f"camera {name}: no such device, file or folder; `ndtorch cameras` lists the devices")


def open_capture(camera: Source, settings: CameraSettings) -> Capture:
    """Open a source.

    Raises:
        InputError: it cannot be opened, or does not take the settings.
    """
    return KINDS[camera.kind].open(camera, settings)
