"""Camera modules of a Raspberry Pi by picamera2, as `cv2.VideoCapture` gives frames; see docs/robot/raspberry-pi.md."""

from __future__ import annotations

from typing import Any

import cv2

from ndtorch.errors import InputError
from ndtorch.utils.packages import need

SETTLING, FIXED = 30, ("ExposureTime", "AnalogueGain", "ColourGains")
"""Frames in which gain and colors settle, and what is fixed then."""


class PicameraCapture:
    """One module. Exposure, gain and colors are fixed; the time of a frame is that of its first row, of the sensor.

    Args:
        number: of the module in `rpicam-hello --list-cameras`.
        size: width and height of a frame, both even.
        exposure_ms: fixed exposure; None is automatic.

    Raises:
        InputError: picamera2 is not installed; no such module; it is in use.
    """

    def __init__(self, number: int, size: tuple[int, int], rate_hz: float, exposure_ms: float | None) -> None:
        library = need("picamera2", "camera modules of a Raspberry Pi")
        self.frame: Any = None
        self.time_ms = 0.0
        try:
            self.device = library.Picamera2(number)
            period_us = round(1e6 / rate_hz)
            # The name of the format is that of libcamera, whose bytes are blue, green, red.
            main = {"size": size, "format": "RGB888"}
            controls = {"FrameDurationLimits": (period_us, period_us)}
            if exposure_ms is not None:
                controls["ExposureTime"] = round(1e3 * exposure_ms)  # type: ignore[assignment]
            self.device.configure(self.device.create_video_configuration(main=main, controls=controls))
            self.device.start()
            if exposure_ms is not None:
                *_, settled = (self.device.capture_metadata() for _ in range(SETTLING))
                fixed = {"AeEnable": False, "AwbEnable": False} | {n: settled[n] for n in FIXED if n in settled}
                known = self.device.camera_controls  # of a monochrome sensor without those of color
                self.device.set_controls({name: value for name, value in fixed.items() if name in known})
        except (RuntimeError, IndexError) as error:
            raise InputError(f"camera picamera2:{number}: cannot be opened ({error})") from None

    def grab(self) -> bool:
        request = self.device.capture_request()
        try:
            self.frame = request.make_array("main")
            self.time_ms = request.get_metadata().get("SensorTimestamp", 0) / 1e6
        finally:
            request.release()
        return True

    def retrieve(self) -> tuple[bool, Any]:
        return self.frame is not None, self.frame

    def get(self, propId: int) -> float:
        return self.time_ms if propId == cv2.CAP_PROP_POS_MSEC else 0.0

    def set(self, propId: int, value: float) -> bool:
        return False

    def release(self) -> None:
        self.device.close()
