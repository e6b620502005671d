"""What can be chosen about the cameras."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from ndtorch.utils.toml import Strict


class CameraSettings(Strict):
    """A table `[cameras]`.

    Args:
        left, right: a device (`/dev/v4l/by-path/...`, `/dev/video0` or a number), a video file, a folder of
            images, or an address with `://`.
        width_px, height_px: size of a frame.
        rate_hz: frames a second that are asked for; also the rate at which folders play.
        fourcc: pixel format, four letters. MJPG lets two cameras share a USB 2 bus, YUYV hardly ever does.
        exposure_ms: fixed exposure; 10 ms hides the flicker of lamps on 50 Hz mains. Left out: automatic.
        gain: fixed gain in the units of the driver. Left out: as the camera has it.
        tolerance_ms: largest difference in time of the two frames of a pair; half a frame pairs all that can be.
        max_age_ms: how long to wait for a pair, and how old one may be.
        calibration: file of `ndtorch calibrate`; left out, the pictures are used as they are.
        pace: files play at their rate (`"real"`), or one frame for every reading (`"read"`).
    """

    left: Annotated[str, Field(min_length=1)]
    right: Annotated[str, Field(min_length=1)]
    width_px: Annotated[int, Field(ge=16, le=8192)] = 640
    height_px: Annotated[int, Field(ge=16, le=8192)] = 480
    rate_hz: Annotated[float, Field(gt=0, le=1000)] = 30.0
    fourcc: Annotated[str, Field(pattern=r"^[ -~]{4}$")] = "MJPG"
    exposure_ms: Annotated[float, Field(gt=0, le=1000)] | None = 10.0
    gain: Annotated[float, Field(ge=0)] | None = None
    tolerance_ms: Annotated[float, Field(gt=0, le=1000)] = 16.0
    max_age_ms: Annotated[float, Field(gt=0, le=10_000)] = 100.0
    calibration: Path | None = None
    pace: Literal["real", "read"] = "real"
