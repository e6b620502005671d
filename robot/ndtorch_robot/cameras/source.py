"""The settings of the cameras, and their sources: devices of the Linux kernel (V4L2), and streams."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Protocol

import cv2
import numpy as np
from pydantic import Field

from ndtorch.errors import InputError
from ndtorch.scenes import readers
from ndtorch.utils.toml import Strict

CLASS, DEV = Path("/sys/class/video4linux"), Path("/dev")

PICAMERA2 = "picamera2:"
"""Beginning of the name of a camera module of a Raspberry Pi."""

MANUAL, AUTOMATIC = 1, 3
"""Values of the V4L2 control `auto_exposure`: manual, and aperture priority."""

EXPOSURE_UNIT_MS, MARGIN = 0.1, 0.05
"""Unit of the V4L2 control `exposure_time_absolute`; relative difference that is ignored: 29.97 Hz for 30."""

Image = np.ndarray[Any, np.dtype[np.uint8]]
"""`[H, W, 3]` in blue, green, red, or `[H, W]` in grey."""


class CameraSettings(Strict):
    """`[cameras]` of a car's file."""

    left: Annotated[str, Field(min_length=1)]
    """Left camera: a device (/dev/v4l/by-path/..., /dev/video0 or a number), picamera2:0, or an address with ://."""
    right: Annotated[str, Field(min_length=1)]
    """Right camera, named like the left one; the same one twice gives both images side by side in each frame."""
    width_px: int = Field(640, ge=16, le=8192)
    """Width of one image, in pixels."""
    height_px: int = Field(480, ge=16, le=8192)
    """Height of a frame, in pixels."""
    rate_hz: float = Field(30.0, gt=0, le=1000)
    """Frame rate that is requested, in Hz."""
    fourcc: str = Field("MJPG", pattern=r"^[ -~]{4}$")
    """Pixel format that is requested; with MJPG two cameras fit on a USB 2 bus, with YUYV hardly ever."""
    exposure_ms: Annotated[float, Field(gt=0, le=1000)] | None = 10.0
    """Fixed exposure, in ms; 10 ms hides the flicker of lamps on 50 Hz mains, and without a value it is automatic."""
    tolerance_ms: float = Field(16.0, gt=0, le=1000)
    """Largest difference in time of the two frames of a pair, in ms."""
    max_age_ms: float = Field(100.0, gt=0, le=10000)
    """Longest wait for a pair, and largest age of one, in ms."""
    calibration: Path | None = None
    """File of `ndtorch calibrate`, OpenCV, Kalibr or KITTI by which frames are rectified; by default they are not."""


class Capture(Protocol):
    """The part of `cv2.VideoCapture` that is used."""

    def grab(self) -> bool: ...

    def retrieve(self) -> tuple[bool, Any]: ...

    def get(self, propId: int) -> float: ...

    def set(self, propId: int, value: float) -> bool: ...

    def release(self) -> None: ...


class Source(NamedTuple):
    """Where frames come from: a device or a stream, as the user wrote it, and the path or address to open."""

    kind: Literal["device", "stream", "picamera2"]
    name: str
    target: str


Opener = Callable[[Source, CameraSettings], Capture]


def find_source(name: str) -> Source:
    """The source that a name means; raises `InputError` where there is no such thing."""
    if name.isdecimal():
        return Source("device", name, f"/dev/video{name}")
    if name.startswith(PICAMERA2) and name.removeprefix(PICAMERA2).isdecimal():
        return Source("picamera2", name, name.removeprefix(PICAMERA2))
    if "://" in name or Path(name).is_fifo():
        return Source("stream", name, name)
    if name.startswith("/dev/"):
        return Source("device", name, name)
    raise InputError(f"camera {name}: neither device nor address; `ndtorch doctor` lists the devices")


def open_capture(camera: Source, settings: CameraSettings) -> Capture:
    """Open a source; raises `InputError` where it cannot be opened, or does not take the settings."""
    if camera.kind == "device":
        return open_device(camera, settings)
    if camera.kind == "picamera2":
        from ndtorch_robot.cameras.picamera import PicameraCapture

        size = settings.width_px, settings.height_px
        return PicameraCapture(int(camera.target), size, settings.rate_hz, settings.exposure_ms)
    capture: Capture | None = readers.open_capture(camera.target)
    if capture is None:
        raise InputError(f"camera {camera.name}: cannot be opened, no stream answers there")
    return capture


def open_device(camera: Source, settings: CameraSettings) -> Capture:
    try:
        # The system says why this fails, OpenCV does not.
        os.close(os.open(camera.target, os.O_RDWR | os.O_NONBLOCK))
    except OSError as error:
        hint = ": add yourself to the group video" if error.errno == errno.EACCES else ""
        raise InputError(f"camera {camera.name}: cannot be opened ({error.strerror}{hint})") from None
    with readers.quiet_opencv():
        capture = cv2.VideoCapture(os.path.realpath(camera.target), cv2.CAP_V4L2)
    if not capture.isOpened():
        raise InputError(f"camera {camera.name}: in use by another program, or no camera that gives images")
    try:
        set_up(capture, camera, settings)
    except InputError:
        capture.release()
        raise
    return capture


def set_up(capture: Capture, camera: Source, settings: CameraSettings) -> None:
    """Set format, size, rate and exposure, and read all of it back."""
    # The order matters: a size is one of a pixel format, and a rate one of a size.
    code, manual = cv2.VideoWriter.fourcc(*settings.fourcc), settings.exposure_ms is not None
    wanted: dict[str, tuple[int, float]] = {
        "fourcc": (cv2.CAP_PROP_FOURCC, code),
        "width": (cv2.CAP_PROP_FRAME_WIDTH, settings.width_px),
        "height": (cv2.CAP_PROP_FRAME_HEIGHT, settings.height_px),
        "frames a second": (cv2.CAP_PROP_FPS, settings.rate_hz),
        "auto_exposure": (cv2.CAP_PROP_AUTO_EXPOSURE, MANUAL if manual else AUTOMATIC),
    }
    if settings.exposure_ms is not None:
        wanted["exposure"] = cv2.CAP_PROP_EXPOSURE, round(settings.exposure_ms / EXPOSURE_UNIT_MS)
    for key, value in wanted.values():
        capture.set(key, value)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 2)  # a driver that wants more takes more: nothing depends on it
    wrong = []
    for name, (key, value) in wanted.items():
        got = capture.get(key)
        if abs(got - value) > (MARGIN * value if key in (cv2.CAP_PROP_FPS, cv2.CAP_PROP_EXPOSURE) else 0.5):
            if name == "fourcc":
                letters = int(got).to_bytes(8, "little", signed=True)[:4].decode("latin1")
                wrong.append(f"fourcc {settings.fourcc!r} became {letters!r}")
            elif name != "auto_exposure" or manual:
                wrong.append(f"{name} {value:g} became {got:g}")
    if wrong:
        raise InputError(
            f"camera {camera.name} does not do what was asked: {'; '.join(wrong)}. "
            f"See `v4l2-ctl -d {camera.target} --list-formats-ext --list-ctrls`"
        )


class Device(NamedTuple):
    """A camera the kernel knows: `/dev/video0`, its name, and the name under `/dev/v4l/by-path`, or None.

    The last one says bus and port, and stays the same while the plug stays where it is.
    """

    node: str
    name: str
    by_path: str | None


def list_devices(classes: Path = CLASS, dev: Path = DEV) -> list[Device]:
    """All nodes that give images. A USB camera has a second node for its metadata, which is left out."""
    links = sorted((dev / "v4l" / "by-path").glob("*"), reverse=True)
    names = {link.resolve().name: str(link) for link in links}
    entries = sorted(classes.glob("video*"), key=lambda path: (len(path.name), path.name))
    return [
        Device(str(dev / entry.name), (entry / "name").read_text().strip(), names.get(entry.name))
        for entry in entries
        if (entry / "index").read_text().strip() == "0"
    ]
