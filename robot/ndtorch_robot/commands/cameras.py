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
    width: int = 640
    """Width of a frame, in pixels."""
    height: int = 480
    """Height of a frame, in pixels."""
    fps: float = 30.0
    """Frames a second that are requested, and at which folders play."""
    json: bool = False
    """Print the result as one JSON object and nothing else."""

    def run(self) -> int:
        if (self.left is None) != (self.right is None):
            raise InputError("give two cameras to measure, left and right, or none to list what is there")
        if not 0 < self.seconds <= 86400:
            raise InputError(f"--seconds must be positive, got {self.seconds}")
        if self.left is not None:
            result = self.measured()
            text = [f"{name:16}{value}" for name, value in result.items()]
        else:
            from ndtorch_robot.cameras import list_devices

            devices = list_devices()
            result = {"devices": [device._asdict() for device in devices]}
            text = [f"{device.node}  {device.name}\n  {device.by_path or 'no name by path'}" for device in devices]
            text = text or ["no cameras: two files, folders of images or addresses can be measured instead"]
        print(json.dumps(result) if self.json else "\n".join(text))
        return 0

    def measured(self) -> dict[str, Any]:
        """Rate and latency of each camera, skew of the pairs, and what was not paired.

        The latency is from when a frame was taken until it was decoded; files are taken when they are due.
        """
        import numpy as np

        from ndtorch.utils.toml import check
        from ndtorch_robot.cameras import CameraSettings, CamerasSilent, FramesEnded, StereoCameras
        from ndtorch_robot.cameras.pair import SIDES
        from ndtorch_robot.car import percentiles_ms

        values: dict[str, object] = {"left": self.left, "right": self.right, "max_age_ms": 500.0}
        values |= {"width_px": self.width, "height_px": self.height, "rate_hz": self.fps}
        until, silences = time.monotonic() + self.seconds, list[str]()
        with StereoCameras(check(values, CameraSettings, "cameras")) as cameras:
            while time.monotonic() < until:
                try:
                    cameras.read_pair()
                except CamerasSilent as silence:
                    silences.append(str(silence))
                except FramesEnded:
                    break
        pairing, result = cameras.pairing, dict[str, Any]()
        for side, name in enumerate(SIDES):
            taken, arrived = np.array(pairing.times[side]).reshape(-1, 2).T
            rate = float(1 / np.diff(taken).mean()) if len(taken) > 1 else None
            result[name] = {"frames": pairing.frames[side], "rate_hz": rate}
            result[name]["latency_ms"] = percentiles_ms(arrived - taken)
        result["skew_ms"] = percentiles_ms(map(abs, pairing.skews))
        result |= {"pairs": pairing.pairs, "unpaired": pairing.unpaired, "silences": len(silences)}
        return result | {"last_silence": silences[-1] if silences else None}
