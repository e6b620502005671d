"""`ndtorch cameras`."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Annotated, Any

import tyro

from ndtorch.errors import InputError


@dataclass(frozen=True)
class Cameras:
    """List the cameras, or measure two of them.

    Without names: what the kernel knows, with the names that stay the same while the plugs stay where they are.
    With two names (devices, numbers, video files, folders of images or addresses): rate, latency and skew.
    """

    left: Annotated[str | None, tyro.conf.Positional] = None
    """The left camera is this device, number, video file, folder of images or address."""
    right: Annotated[str | None, tyro.conf.Positional] = None
    """The right camera is named like the left one."""
    seconds: float = 5.0
    """Measuring takes this time, in s."""
    width: int | None = None
    """This width is requested, in pixels (default: 640, and that of files)."""
    height: int | None = None
    """This height is requested, in pixels (default: 480, and that of files)."""
    fps: float = 30.0
    """This number of frames a second is requested, and folders play at it."""
    fourcc: str = "MJPG"
    """This pixel format is requested."""
    exposure_ms: float | None = 10.0
    """The exposure is fixed to this time, in ms; with 0 it is automatic."""
    tolerance_ms: float = 16.0
    """The two frames of a pair differ in time by at most this, in ms."""
    json: bool = False
    """The result is printed as one JSON object, and nothing else is."""

    def run(self) -> int:
        if (self.left is None) != (self.right is None):
            raise InputError("give two cameras to measure, left and right, or none to list what is there")
        if not 0 < self.seconds <= 86400:
            raise InputError(f"--seconds must be positive, got {self.seconds}")
        result = self.listed() if self.left is None else self.measured()
        if self.json:
            print(json.dumps(result))
        else:
            print(describe_devices(result) if self.left is None else describe(result))
        return 0

    def listed(self) -> dict[str, Any]:
        from ndtorch_robot.cameras import list_devices

        return {"devices": [device._asdict() | {"usb": _usb(device.usb)} for device in list_devices()]}

    def measured(self) -> dict[str, Any]:
        from ndtorch.utils.toml import check
        from ndtorch_robot.cameras import StereoCameras, find_source
        from ndtorch_robot.cameras.measure import measure
        from ndtorch_robot.cameras.pair import probe_size
        from ndtorch_robot.cameras.source import CameraSettings

        values: dict[str, object] = {
            "left": self.left,
            "right": self.right,
            "width_px": self.width or 640,
            "height_px": self.height or 480,
            "rate_hz": self.fps,
            "fourcc": self.fourcc,
            "exposure_ms": self.exposure_ms or None,
            "tolerance_ms": self.tolerance_ms,
            "max_age_ms": 500.0,
        }
        settings = check(values, CameraSettings, "cameras")
        source = find_source(settings.left)
        if self.width is None and self.height is None and not source.live:
            width, height = probe_size(source, settings)
            settings = settings.model_copy(update={"width_px": width, "height_px": height})
        with StereoCameras(settings) as cameras:
            return measure(cameras, self.seconds) | {"size": [settings.width_px, settings.height_px]}


def _usb(place: Any) -> dict[str, Any] | None:
    return None if place is None else place._asdict()


def describe_devices(result: dict[str, Any]) -> str:
    if not result["devices"]:
        return (
            "no cameras: the kernel knows none (/sys/class/video4linux is empty or not there)\n"
            "Two files, folders of images or addresses can be measured in their place."
        )
    lines = []
    for device in result["devices"]:
        usb = device["usb"]
        place = f"USB bus {usb['bus']} port {usb['port']}, {usb['speed']:g} Mbit/s" if usb else "not on the USB"
        lines += [f"{device['node']}  {device['name']}", f"  {place}", f"  {device['by_path'] or 'no name by path'}"]
    buses = [device["usb"]["bus"] for device in result["devices"] if device["usb"]]
    if len(buses) > len(set(buses)):
        lines.append("Cameras on one USB 2 bus may not fit together: measure them, and see docs/robot/cameras.md.")
    return "\n".join(lines)


def describe(result: dict[str, Any]) -> str:
    lines = [f"{result['size'][0]}x{result['size'][1]}, {result['pairs']} pairs, unpaired {result['unpaired']}"]
    for name in ("left", "right"):
        part = result[name]
        if "rate_hz" not in part:
            lines.append(f"{name:6s} only {part['frames']} frames")
            continue
        gap, late = part["interval_ms"], part["latency_ms"]
        lines.append(
            f"{name:6s} {part['rate_hz']:.2f} frames/s, interval {gap['p1']:.1f} - {gap['p50']:.1f} - "
            f"{gap['p99']:.1f} ms (1, 50, 99 %), latency {late['p50']:.1f} ms, 99 % below {late['p99']:.1f} ms, "
            f"most {late['max']:.1f} ms"
        )
    if result["skew_ms"]:
        skew = result["skew_ms"]
        lines.append(
            f"skew   mean {skew['mean']:+.2f} ms (right later), size {skew['p50']:.2f} ms, "
            f"99 % below {skew['p99']:.2f} ms, most {skew['max']:.2f} ms"
        )
    if result["silences"]:
        lines.append(f"no pair {result['silences']} times; last: {result['last_silence']}")
    if result["ended"]:
        lines.append(result["ended"])
    return "\n".join(lines)
