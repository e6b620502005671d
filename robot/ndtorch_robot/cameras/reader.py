"""One thread a camera: it waits for frames, so that nobody else has to."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from ndtorch.errors import InputError
from ndtorch_robot.cameras.pairing import Frame
from ndtorch_robot.cameras.source import CameraSettings, Capture, Opener, Source

BACK_OFF = (0.2, 0.5, 1.0, 2.0)
"""Seconds before each attempt to open a lost camera again; the last one repeats."""

TRUSTED = 1.0
"""A driver's time is believed when it lies within this many seconds before now."""


class CameraReader:
    """Reads one source in a thread, and hands over every frame with the time at which it was taken.

    A live camera that is lost is opened again, with growing pauses, until it is back or the reader is closed.
    A file ends once.

    Args:
        source, settings, opener: what to open and how.
        deliver: called with each frame, in the thread of the reader.

    Attributes:
        due: for files that play at their rate: when the next frame is due, s on the monotonic clock.
        trouble: why there are no frames at present, or nothing.
        ended: whether a file has no more frames.
        lost: how often the camera was lost.
    """

    def __init__(
        self, source: Source, settings: CameraSettings, opener: Opener, deliver: Callable[[Frame], None]
    ) -> None:
        self.source, self.settings, self.opener, self.deliver = source, settings, opener, deliver
        self.capture: Capture | None = opener(source, settings)
        self.due, self.period = 0.0, 1.0 / frame_rate(self.capture, source, settings)
        self.trouble, self.ended, self.lost, self.frames = "", False, 0, 0
        self.closed = threading.Event()
        self.thread = threading.Thread(target=self.run, name=f"camera {source.name}", daemon=True)

    def run(self) -> None:
        try:
            while not self.closed.is_set():
                if not self.source.live:
                    self.closed.wait(max(0.0, self.due - time.monotonic()))
                if self.step():
                    continue
                self.release()
                if not self.source.live:
                    self.ended = True
                    return
                self.lost += 1
                self.reopen()
        except Exception as error:  # nobody sees what a thread dies of
            self.trouble = f"its reader failed: {type(error).__name__}: {error}"
        finally:
            self.release()

    def step(self) -> bool:
        capture = self.capture
        assert capture is not None
        if not capture.grab():
            return False
        # A file is taken when it is due: one that is decoded too slowly gets old like a camera that lags.
        taken = driver_time(capture, time.monotonic()) if self.source.live else self.due
        good, image = capture.retrieve()
        if not good or image is None:
            return False
        self.due += self.period
        self.trouble = ""
        self.frames += 1
        self.deliver(Frame(image, taken, time.monotonic()))
        return True

    def reopen(self) -> None:
        self.trouble = "no more frames: unplugged, or stopped by the driver"
        attempt = 0
        while not self.closed.wait(BACK_OFF[min(attempt, len(BACK_OFF) - 1)]):
            attempt += 1
            try:
                self.capture = self.opener(self.source, self.settings)
                return
            except InputError as error:
                self.trouble = str(error)

    def release(self) -> None:
        if self.capture is not None:
            self.capture.release()
            self.capture = None

    def close(self, patience: float = 1.0) -> None:
        """Stop. A driver that hangs is left to itself after `patience` seconds."""
        self.closed.set()
        if self.thread.is_alive() and self.thread is not threading.current_thread():
            self.thread.join(patience)
        if not self.thread.is_alive():
            self.release()


def driver_time(capture: Capture, now: float) -> float:
    """When the frame just grabbed was taken.

    V4L2 stamps frames with the monotonic clock as they begin to arrive, and OpenCV passes that on as the
    position in ms. Anything else is no such time, and then it is now.
    """
    import cv2

    stamp = capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3
    return stamp if now - TRUSTED < stamp <= now else now


def frame_rate(capture: Capture, source: Source, settings: CameraSettings) -> float:
    """Frames a second: what a file declares, where that makes sense."""
    import cv2

    declared = 0.0 if source.live else capture.get(cv2.CAP_PROP_FPS)
    return declared if 0 < declared <= 1000 else settings.rate_hz
