"""Cameras of the Linux kernel (V4L2): listing, opening and setting up."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import NamedTuple

import cv2

from ndtorch.errors import InputError
from ndtorch.scenes.readers import quiet_opencv
from ndtorch_robot.cameras.source import CameraSettings, Capture, Source, camera_source

CLASS, DEV = Path("/sys/class/video4linux"), Path("/dev")

MANUAL, AUTOMATIC = 1, 3
"""Values of the V4L2 control `auto_exposure`: manual, and aperture priority."""

EXPOSURE_UNIT_MS = 0.1
"""Unit of the V4L2 control `exposure_time_absolute`."""

MARGIN = 0.05
"""Relative difference of rates and exposures that is ignored: cameras that say 29.97 for 30 mean the same."""

REASONS = {
    errno.ENOENT: "no such device; `ndtorch cameras` lists those that are there",
    errno.ENODEV: "no such device; `ndtorch cameras` lists those that are there",
    errno.EACCES: "no permission: add yourself to the group video (sudo usermod -aG video $USER), log in anew",
    errno.EBUSY: "in use by another program",
}


def device_node(name: str) -> str | None:
    """The node that a number, `camera:N`, or a path of a character device means."""
    number, path = name.removeprefix("camera:"), Path(name)
    if number.isdecimal():
        return f"/dev/video{number}"
    device = name.startswith("/dev/") or (path.exists() and stat.S_ISCHR(path.stat().st_mode))
    return name if device else None


@camera_source("device", device_node, live=True)
def open_device(camera: Source, settings: CameraSettings) -> Capture:
    try:
        # The system says why this fails, OpenCV does not.
        os.close(os.open(camera.target, os.O_RDWR | os.O_NONBLOCK))
    except OSError as error:
        reason = REASONS.get(error.errno or 0, f"cannot be opened ({error.strerror})")
        raise InputError(f"camera {camera.name}: {reason}") from None
    with quiet_opencv():
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
    """Set format, size, rate, exposure and gain, and read all of it back."""
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
    if settings.gain is not None:
        wanted["gain"] = cv2.CAP_PROP_GAIN, settings.gain
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
    """A camera the kernel knows.

    Attributes:
        node: `/dev/video0`.
        name: what it calls itself.
        by_path: the name under `/dev/v4l/by-path` that stays the same while the plug stays where it is, or None; it
            says bus and port.
    """

    node: str
    name: str
    by_path: str | None


def list_devices(classes: Path = CLASS, dev: Path = DEV) -> list[Device]:
    """All nodes that give images. A USB camera has a second node for its metadata, which is left out."""
    folder = dev / "v4l" / "by-path"
    links = sorted(folder.iterdir(), reverse=True) if folder.is_dir() else []
    names = {link.resolve().name: str(link) for link in links}
    entries = sorted(classes.glob("video*"), key=lambda path: (len(path.name), path.name))
    return [
        Device(str(dev / entry.name), text(entry / "name"), names.get(entry.name))
        for entry in entries
        if text(entry / "index") in ("0", "")
    ]


def text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""
