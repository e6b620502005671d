"""Cameras of the Linux kernel (V4L2): which there are, who uses one, opening and setting one up."""

from __future__ import annotations

import errno
import grp
import os
import stat
from pathlib import Path
from typing import NamedTuple

from ndtorch.errors import InputError
from ndtorch.scenes.readers import quiet_opencv
from ndtorch_robot.cameras.source import CameraSettings, Capture, Source, camera_source

CLASS = Path("/sys/class/video4linux")
DEV = Path("/dev")
PROC = Path("/proc")

MANUAL, AUTOMATIC = 1, 3
"""Values of the V4L2 control `auto_exposure`: manual, and aperture priority."""

EXPOSURE_UNIT_MS = 0.1
"""Unit of the V4L2 control `exposure_time_absolute`."""

RATE_MARGIN = 0.05
"""Cameras that say 29.97 for 30 mean the same."""


def device_node(name: str) -> str | None:
    """The node that a number, `camera:N`, or a path of a character device means."""
    number = name.removeprefix("camera:")
    if number.isdecimal():
        return f"/dev/video{number}"
    path = Path(name)
    if name.startswith("/dev/") or (path.exists() and stat.S_ISCHR(path.stat().st_mode)):
        return name
    return None


@camera_source("device", device_node, live=True)
def open_device(camera: Source, settings: CameraSettings) -> Capture:
    import cv2

    try_device(camera)
    with quiet_opencv():
        capture = cv2.VideoCapture(os.path.realpath(camera.target), cv2.CAP_V4L2)
    if not capture.isOpened():
        raise InputError(f"camera {camera.name}: {busy(camera.target) or 'no camera that gives images'}")
    try:
        set_up(capture, camera, settings)
    except InputError:
        capture.release()
        raise
    return capture


def try_device(camera: Source) -> None:
    """Open a node for a moment: the system says why that fails, OpenCV does not."""
    target = camera.target
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
        raise InputError(f"camera {camera.name}: {reason}") from None


def busy(target: str) -> str:
    who = holders(target)
    return f"in use by {', '.join(who)}" if who else ""


def set_up(capture: Capture, camera: Source, settings: CameraSettings) -> None:
    """Set format, size, rate, exposure and gain, and read all of it back."""
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
            f"camera {camera.name} does not do what was asked: {'; '.join(wrong)}. "
            f"See `v4l2-ctl -d {camera.target} --list-formats-ext --list-ctrls`"
        )


def four_letters(code: float) -> str:
    return int(code).to_bytes(8, "little", signed=True)[:4].decode("latin1")


class UsbPlace(NamedTuple):
    """Where a camera is plugged in: number and speed (Mbit/s) of the bus, and the port, `"1-2.3"`."""

    bus: int
    speed: float
    port: str


class Device(NamedTuple):
    """A camera the kernel knows.

    Attributes:
        node: `/dev/video0`.
        name: what it calls itself.
        by_path: the name under `/dev/v4l/by-path` that stays the same while the plug stays where it is, or None.
        usb: its place, or None where it is not on the USB.
    """

    node: str
    name: str
    by_path: str | None
    usb: UsbPlace | None


def list_devices(classes: Path = CLASS, dev: Path = DEV) -> list[Device]:
    """All nodes that give images. A USB camera has a second node for its metadata, which is left out."""
    if not classes.is_dir():
        return []
    names = by_path(dev)
    found = []
    for entry in sorted(classes.iterdir(), key=lambda path: (len(path.name), path.name)):
        if not entry.name.startswith("video") or text(entry / "index") not in ("0", ""):
            continue
        node = str(dev / entry.name)
        found.append(Device(node, text(entry / "name"), names.get(entry.name), usb_place(entry)))
    return found


def by_path(dev: Path = DEV) -> dict[str, str]:
    """Names under `/dev/v4l/by-path` by the node they lead to: `{"video0": "/dev/v4l/by-path/..."}`."""
    folder = dev / "v4l" / "by-path"
    if not folder.is_dir():
        return {}
    return {link.resolve().name: str(link) for link in sorted(folder.iterdir(), reverse=True)}


def usb_place(entry: Path) -> UsbPlace | None:
    device = (entry / "device").resolve()
    for folder in (device, *device.parents):
        if (folder / "busnum").is_file():
            try:
                return UsbPlace(int(text(folder / "busnum")), float(text(folder / "speed") or 0), folder.name)
            except ValueError:
                return None
    return None


def place_of(node: str, classes: Path = CLASS) -> UsbPlace | None:
    """The place of `/dev/videoN` or of a link to it on the USB."""
    return usb_place(classes / Path(node).resolve().name)


def group_of(node: str) -> str:
    try:
        return grp.getgrgid(Path(node).stat().st_gid).gr_name
    except (OSError, KeyError):
        return "video"


def holders(node: str, proc: Path = PROC) -> list[str]:
    """Programs that have a node open, as far as this user may know: `["cheese (1234)"]`."""
    target = str(Path(node).resolve())
    found = []
    for process in proc.iterdir():
        if not process.name.isdigit() or int(process.name) == os.getpid():
            continue
        try:
            if any(str(link.readlink()) == target for link in (process / "fd").iterdir()):
                found.append(f"{text(process / 'comm') or '?'} ({process.name})")
        except OSError:  # of another user, or just ended
            continue
    return found


def text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""
