"""What the kernel says about cameras: names, places on the USB, and who holds one."""

from __future__ import annotations

import grp
import os
from pathlib import Path
from typing import NamedTuple

CLASS = Path("/sys/class/video4linux")
DEV = Path("/dev")
PROC = Path("/proc")


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
    """All nodes that give pictures. A USB camera has a second node for its metadata, which is left out."""
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
    """The place of `/sys/class/video4linux/videoN` on the USB."""
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
    """The group that may use a node; `video` on most systems."""
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
    """Contents of a small file, or nothing."""
    try:
        return path.read_text().strip()
    except OSError:
        return ""
