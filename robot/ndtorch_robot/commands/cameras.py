"""`ndtorch cameras`."""

from __future__ import annotations

import json
import time
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
    """Left camera: device, number, video file, folder of images or address."""
    right: Annotated[str | None, tyro.conf.Positional] = None
    """Right camera, named like the left one."""
    seconds: float = 5.0
    """Duration of the measurement, in s."""
    width: int | None = None
    """Width of a frame, in pixels (default: 640, and that of files)."""
    height: int | None = None
    """Height of a frame, in pixels (default: 480, and that of files)."""
    fps: float = 30.0
    """Frames a second that are requested, and at which folders play."""
    fourcc: str = "MJPG"
    """Pixel format that is requested."""
    exposure_ms: float | None = 10.0
    """Fixed exposure, in ms; 0 is automatic."""
    tolerance_ms: float = 16.0
    """Largest difference in time of the two frames of a pair, in ms."""
    json: bool = False
    """Print the result as one JSON object and nothing else."""

    def run(self) -> int:
        if (self.left is None) != (self.right is None):
            raise InputError("give two cameras to measure, left and right, or none to list what is there")
        if not 0 < self.seconds <= 86400:
            raise InputError(f"--seconds must be positive, got {self.seconds}")
        if self.left is not None:
            result = self.measured()
            text = lines(result)
        else:
            from ndtorch_robot.cameras import list_devices

            devices = list_devices()
            result = {"devices": [device._asdict() for device in devices]}
            text = [f"{device.node}  {device.name}\n  {device.by_path or 'no name by path'}" for device in devices]
            text = text or ["no cameras: two files, folders of images or addresses can be measured instead"]
        print(json.dumps(result) if self.json else "\n".join(text))
        return 0

    def measured(self) -> dict[str, Any]:
        """Rate, interval and latency of each camera, skew of the pairs, and what was not paired.

        The latency is from when a frame was taken until it was decoded; files are taken when they are due.
        """
        import numpy as np

        from ndtorch.utils.toml import check
        from ndtorch_robot.cameras import CameraSettings, CamerasSilent, FramesEnded, StereoCameras, find_source
        from ndtorch_robot.cameras.pair import SIDES, probe_size

        values: dict[str, object] = {"left": self.left, "right": self.right, "max_age_ms": 500.0}
        values |= {"width_px": self.width or 640, "height_px": self.height or 480, "rate_hz": self.fps}
        values |= {"fourcc": self.fourcc, "exposure_ms": self.exposure_ms or None, "tolerance_ms": self.tolerance_ms}
        settings = check(values, CameraSettings, "cameras")
        source = find_source(settings.left)
        if self.width is None and self.height is None and not source.live:
            width, height = probe_size(source, settings)
            settings = settings.model_copy(update={"width_px": width, "height_px": height})
        until, silences, ended = time.monotonic() + self.seconds, [""], ""
        with StereoCameras(settings) as cameras:
            while time.monotonic() < until and not ended:
                try:
                    cameras.read_pair()
                except CamerasSilent as silence:
                    silences.append(str(silence))
                except FramesEnded as end:
                    ended = str(end)
        pairing, result = cameras.pairing, dict[str, Any]()
        for side, name in enumerate(SIDES):
            times = np.array(pairing.times[side])
            result[name] = {"frames": pairing.frames[side]}
            if len(times) > 2:
                gaps, latency = np.diff(times[:, 0]) * 1e3, (times[:, 1] - times[:, 0]) * 1e3
                result[name] |= {"rate_hz": float(1e3 / gaps.mean()), "interval_ms": percentiles(gaps)}
                result[name]["latency_ms"] = percentiles(latency)
        skews = np.array(pairing.skews) * 1e3
        result["skew_ms"] = {"mean": float(skews.mean()), **percentiles(np.abs(skews))} if len(skews) else {}
        result |= {"pairs": pairing.pairs, "unpaired": pairing.unpaired, "silences": len(silences) - 1}
        size = [settings.width_px, settings.height_px]
        return result | {"last_silence": silences[-1], "ended": ended, "size": size}


def percentiles(values: Any) -> dict[str, float]:
    import numpy as np

    return dict(zip(("p1", "p50", "p99", "max"), np.percentile(values, (1, 50, 99, 100)).tolist(), strict=True))


def lines(result: dict[str, Any]) -> list[str]:
    text = [f"{result['size'][0]}x{result['size'][1]}, {result['pairs']} pairs, unpaired {result['unpaired']}"]
    for name in ("left", "right"):
        part = result[name]
        words = f"{name:6s} {part['frames']} frames"
        for key, what in (("interval_ms", "interval"), ("latency_ms", "latency")):
            if key in part:
                words += f", {what} {part[key]['p50']:.1f} ms, 99 % below {part[key]['p99']:.1f} ms"
        text.append(words + (f", {part['rate_hz']:.2f} frames/s" if "rate_hz" in part else ""))
    if result["skew_ms"]:
        skew = result["skew_ms"]
        text.append(f"skew   mean {skew['mean']:+.2f} ms (right later), 99 % within {skew['p99']:.2f} ms")
    if result["silences"]:
        text.append(f"no pair {result['silences']} times; last: {result['last_silence']}")
    return [*text, result["ended"]] if result["ended"] else text
