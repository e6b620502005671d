"""Opening one camera, file, folder or stream, and saying in one line why that does not work."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np

from ndtorch.errors import InputError
from ndtorch.scenes.quiet import quiet_opencv
from ndtorch.scenes.readers import FolderReader
from ndtorch_robot.cameras.settings import CameraSettings
from ndtorch_robot.cameras.sysfs import group_of, holders

Image = np.ndarray[Any, np.dtype[np.uint8]]
"""`[H, W, 3]` in blue, green, red, or `[H, W]` in grey."""

MANUAL, AUTOMATIC = 1, 3
"""Values of the V4L2 control `auto_exposure`: manual, and aperture priority."""

EXPOSURE_UNIT_MS = 0.1
"""Unit of the V4L2 control `exposure_time_absolute`."""

RATE_MARGIN = 0.05
"""Cameras that say 29.97 for 30 mean the same."""


class Capture(Protocol):
    """The part of `cv2.VideoCapture` that is used."""

    def grab(self) -> bool:
        """Wait for the next frame; False when there is none."""
        ...

    def retrieve(self) -> tuple[bool, Any]:
        """Decode the frame that was grabbed: `Image`, or nothing."""
        ...

    def get(self, propId: int) -> float:
        """A property."""
        ...

    def set(self, propId: int, value: float) -> bool:
        """Ask for a property."""
        ...

    def release(self) -> None:
        """Let go."""
        ...


class Source(NamedTuple):
    """Where frames come from: what it is, what the user called it, and the path or address to open."""

    kind: Literal["device", "file", "folder", "stream"]
    name: str
    target: str

    @property
    def live(self) -> bool:
        """Whether frames come by themselves."""
        return self.kind in ("device", "stream")


Opener = Callable[[Source, CameraSettings], Capture]


def find_source(name: str) -> Source:
    """What a name means: a number or a character device is a camera, `://` a stream, the rest is on the disk.

    Raises:
        InputError: there is no such thing.
    """
    if name.removeprefix("camera:").isdecimal():
        return Source("device", name, f"/dev/video{name.removeprefix('camera:')}")
    if "://" in name:
        return Source("stream", name, name)
    path = Path(name)
    if name.startswith("/dev/"):
        return Source("device", name, name)
    if path.is_dir():
        return Source("folder", name, name)
    if not path.exists():
        raise InputError(f"camera {name}: no such device, file or folder; `ndtorch cameras` lists the devices")
    mode = path.stat().st_mode
    if stat.S_ISFIFO(mode):
        return Source("stream", name, name)
    return Source("device" if stat.S_ISCHR(mode) else "file", name, name)


def open_capture(source: Source, settings: CameraSettings) -> Capture:
    """Open a source; a device is also set up, and asked whether it does what was wanted.

    Raises:
        InputError: no such device, no permission, in use, no video, or settings that the camera does not take.
    """
    if source.kind == "folder":
        return FolderCapture(Path(source.target), settings.rate_hz)
    import cv2

    if source.kind == "device":
        try_device(source)
    elif source.kind == "file" and not os.access(source.target, os.R_OK):
        raise InputError(f"camera {source.name}: no permission to read this file")
    with quiet_opencv():
        if source.kind == "device":
            capture = cv2.VideoCapture(os.path.realpath(source.target), cv2.CAP_V4L2)
        else:
            capture = cv2.VideoCapture(source.target)
    if not capture.isOpened():
        if source.kind == "device":
            raise InputError(f"camera {source.name}: {busy(source.target) or 'no camera that gives pictures'}")
        wanted = "a video" if source.kind == "file" else "a stream that answers"
        raise InputError(f"camera {source.name}: cannot be opened, it is not {wanted}")
    if source.kind == "device":
        try:
            set_up(capture, source, settings)
        except InputError:
            capture.release()
            raise
    return capture


def try_device(source: Source) -> None:
    """Open a device node for a moment, because the system says why that fails and OpenCV does not."""
    target = source.target
    try:
        os.close(os.open(target, os.O_RDWR | os.O_NONBLOCK))
    except OSError as error:
        if error.errno in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
            reason = "no such device; `ndtorch cameras` lists those that are there"
        elif error.errno in (errno.EACCES, errno.EPERM):
            group = group_of(target)
            reason = f"no permission: add yourself to the group {group!r} (sudo usermod -aG {group} $USER), log in anew"
        elif error.errno == errno.EBUSY:
            reason = busy(target) or "in use"
        else:
            reason = f"cannot be opened ({error.strerror})"
        raise InputError(f"camera {source.name}: {reason}") from None


def busy(target: str) -> str:
    """Who uses a device, as a reason; nothing where nobody is known to."""
    who = holders(target)
    return f"in use by {', '.join(who)}" if who else ""


def set_up(capture: Capture, source: Source, settings: CameraSettings) -> None:
    """Set format, size, rate, exposure and gain, and read all of it back.

    Raises:
        InputError: naming everything that the camera does otherwise.
    """
    import cv2

    # The order matters: a size is one of a pixel format, and a rate one of a size.
    capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*settings.fourcc))
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, settings.width_px)
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, settings.height_px)
    capture.set(cv2.CAP_PROP_FPS, settings.rate_hz)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 2)  # a driver that wants more takes more: nothing depends on it
    capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, AUTOMATIC if settings.exposure_ms is None else MANUAL)
    if settings.exposure_ms is not None:
        capture.set(cv2.CAP_PROP_EXPOSURE, round(settings.exposure_ms / EXPOSURE_UNIT_MS))
    if settings.gain is not None:
        capture.set(cv2.CAP_PROP_GAIN, settings.gain)

    wrong = []
    code = four_letters(capture.get(cv2.CAP_PROP_FOURCC))
    if code != settings.fourcc:
        wrong.append(f"fourcc {settings.fourcc!r} became {code!r}")
    size = (round(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), round(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)))
    if size != (settings.width_px, settings.height_px):
        wrong.append(f"{settings.width_px}x{settings.height_px} became {size[0]}x{size[1]}")
    rate = capture.get(cv2.CAP_PROP_FPS)
    if abs(rate / settings.rate_hz - 1) > RATE_MARGIN:
        wrong.append(f"{settings.rate_hz:g} frames a second became {rate:g}")
    if settings.exposure_ms is not None:
        if round(capture.get(cv2.CAP_PROP_AUTO_EXPOSURE)) != MANUAL:
            wrong.append("the exposure stays automatic")
        exposure = capture.get(cv2.CAP_PROP_EXPOSURE) * EXPOSURE_UNIT_MS
        if abs(exposure / settings.exposure_ms - 1) > RATE_MARGIN:
            wrong.append(f"an exposure of {settings.exposure_ms:g} ms became {exposure:g} ms")
    if settings.gain is not None and abs((gain := capture.get(cv2.CAP_PROP_GAIN)) - settings.gain) > 0.5:
        wrong.append(f"a gain of {settings.gain:g} became {gain:g}")
    if wrong:
        raise InputError(
            f"camera {source.name} does not do what was asked: {'; '.join(wrong)}. "
            f"See `v4l2-ctl -d {source.target} --list-formats-ext --list-ctrls`"
        )


def four_letters(code: float) -> str:
    """The letters of a pixel format."""
    return int(code).to_bytes(8, "little", signed=True)[:4].decode("latin1")


class FolderCapture:
    """The images of a folder in natural order, as a capture."""

    def __init__(self, folder: Path, rate: float) -> None:
        self.files, self.rate, self.next = FolderReader(folder).files, rate, 0

    def grab(self) -> bool:
        """Go to the next image."""
        self.next += 1
        return self.next <= len(self.files)

    def retrieve(self) -> tuple[bool, Any]:
        """Read it."""
        import cv2

        with quiet_opencv():
            image = cv2.imread(str(self.files[self.next - 1]), cv2.IMREAD_ANYCOLOR)
        return image is not None, image

    def get(self, propId: int) -> float:
        """Rate and number of images; 0 for the rest."""
        import cv2

        return {cv2.CAP_PROP_FPS: self.rate, cv2.CAP_PROP_FRAME_COUNT: float(len(self.files))}.get(propId, 0.0)

    def set(self, propId: int, value: float) -> bool:
        """Nothing can be set."""
        return False

    def release(self) -> None:
        """Nothing to let go of."""
