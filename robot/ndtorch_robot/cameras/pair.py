"""The pair of cameras as the loop sees it, rectified where there is a calibration."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import cv2
import torch
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.navigation import Rect, StereoRig
from ndtorch.navigation.options import NavigatorOptions
from ndtorch.navigation.stereo.calibration_files import load_calibration
from ndtorch_robot.calibration import Rectifier
from ndtorch_robot.cameras.source import CameraSettings, Capture, Image, Opener, Source, find_source, open_capture
from ndtorch_robot.ports import Closing, StereoFrames

SIDES = ("left", "right")

FIRST_FRAME_S = 5.0
"""Time within which a camera must give its first frame; some take two seconds to switch on."""

BACK_OFF_S = (0.2, 0.5, 1.0, 2.0)
"""Pauses before each attempt to open a lost camera again; the last one repeats."""

TRUSTED_S, KEPT = 1.0, 3000
"""Largest age of a driver's time that is believed, and number of last pairs whose differences in time are kept."""


class CamerasSilent(InputError):
    """No pair of frames came in time. Reading may be tried again: cameras come back."""


class CameraFrame(NamedTuple):
    """One image of one camera, as OpenCV gives it, and when it was taken, s on the monotonic clock."""

    image: Image
    time: float


class FramePair(NamedTuple):
    """Two frames of one moment."""

    left: CameraFrame
    right: CameraFrame

    @property
    def time(self) -> float:
        """When the older one was taken: what is said about age is then never too good."""
        return min(self.left.time, self.right.time)


class Pairing:
    """Pairs frames by their times, as they come.

    Only the newest frame of each camera is kept. A frame is paired with the newest one of the other camera,
    if that is still free and not more than the tolerance, s, away, so no frame is used twice.
    """

    def __init__(self, tolerance: float) -> None:
        self.tolerance = tolerance
        self.newest: list[CameraFrame | None] = [None, None]
        self.free, self.unpaired = [False, False], [0, 0]  # no partner: the newest, how many
        self.skews: deque[float] = deque(maxlen=KEPT)  # right frames after their left ones, s

    def add(self, side: int, frame: CameraFrame) -> FramePair | None:
        """A new frame of camera `side` (0 left, 1 right); returns the pair it makes, if it does."""
        self.unpaired[side] += self.free[side]
        self.newest[side], self.free[side] = frame, True
        other = self.newest[1 - side]
        if other is None or not self.free[1 - side] or abs(frame.time - other.time) > self.tolerance:
            return None
        self.free = [False, False]
        pair = FramePair(frame, other) if side == 0 else FramePair(other, frame)
        self.skews.append(pair.right.time - pair.left.time)
        return pair


class CameraReader:
    """Reads one source in a thread, and hands over every frame with the time at which it was taken.

    A camera that is lost is opened again, with growing pauses, until it is back or the reader is closed.
    Meanwhile `trouble` says why there are no frames.
    """

    def __init__(
        self, source: Source, settings: CameraSettings, opener: Opener, deliver: Callable[[CameraFrame], None]
    ) -> None:
        self.source, self.settings, self.opener, self.deliver = source, settings, opener, deliver
        self.capture: Capture | None = opener(source, settings)
        self.trouble, self.closed = "", threading.Event()
        self.thread = threading.Thread(target=self.run, name=f"camera {source.name}", daemon=True)

    def run(self) -> None:
        try:
            while not self.closed.is_set():
                if not self.step():
                    self.release()
                    self.reopen()
        except Exception as error:  # nobody sees what a thread dies of
            self.trouble = f"its reader failed: {type(error).__name__}: {error}"
        finally:
            self.release()

    def step(self) -> bool:
        capture = self.capture
        if capture is None or not capture.grab():
            return False
        taken = driver_time(capture, time.monotonic())
        good, image = capture.retrieve()
        if not good or image is None:
            return False
        self.trouble = ""
        self.deliver(CameraFrame(image, taken))
        return True

    def reopen(self) -> None:
        self.trouble, attempt = "no more frames: unplugged, or stopped by the driver", 0
        while not self.closed.wait(BACK_OFF_S[min(attempt, len(BACK_OFF_S) - 1)]):
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
        if self.thread.is_alive():
            self.thread.join(patience)
        if not self.thread.is_alive():
            self.release()


class StereoCameras(Closing):
    """Two cameras that run freely, one reader thread each; implements `ndtorch_robot.ports.CameraPair`.

    Each reading gives the newest pair that has not been read yet, and waits for it when it must. The time of a
    pair is that of its older frame. A source that is both left and right gives both images side by side. Frames
    are whole ones `[1, C, H, W]` uint8, red, green, blue, or with `rectify`, which `open_cameras` makes, the
    rectified strips.

    Raises:
        InputError: a source that cannot be opened or gives no frames or ones of another size.
    """

    def __init__(
        self, settings: CameraSettings, rectify: Rectifier | None = None, opener: Opener = open_capture
    ) -> None:
        self.settings, self.rectify = settings, rectify
        sources = [find_source(settings.left), find_source(settings.right)]
        self.joined = sources[0].target == sources[1].target
        if self.joined:
            del sources[1]
            settings = settings.model_copy(update={"width_px": 2 * settings.width_px})
        self.changed, self.pairing = threading.Condition(), Pairing(settings.tolerance_ms / 1e3)
        self.pair: FramePair | None = None
        self.readers: list[CameraReader] = []
        try:
            for side, source in enumerate(sources):
                self.readers.append(CameraReader(source, settings, opener, partial(self.add, side)))
            for side, reader in enumerate(self.readers):
                reader.thread.start()
                self.wait_for_first(side)
        except BaseException as error:
            self.close()
            if self.joined and isinstance(error, InputError):
                raise InputError(f"left and right are one camera, of images side by side: {error}") from None
            raise

    def wait_for_first(self, side: int) -> None:
        reader, newest = self.readers[side], self.pairing.newest
        with self.changed:
            self.changed.wait_for(lambda: newest[side] is not None or reader.trouble, FIRST_FRAME_S)
            frame = newest[side]
        if frame is not None:
            return self.check_image(side, frame.image)
        why = reader.trouble or f"nothing for {FIRST_FRAME_S:g} s"
        hint = "; a USB 2 bus often has no room for two cameras: see docs/robot/cameras.md" if side == 1 else ""
        raise InputError(f"the {SIDES[side]} camera ({reader.source.name}) opens but gives no frame ({why}){hint}")

    def add(self, side: int, frame: CameraFrame) -> None:
        middle = frame.image.shape[1] // 2
        halves = (frame.image[:, :middle], frame.image[:, middle:]) if self.joined else (frame.image,)
        with self.changed:
            for n, image in enumerate(halves):
                self.pair = self.pairing.add(side + n, CameraFrame(image, frame.time)) or self.pair
            self.changed.notify_all()

    def read(self) -> StereoFrames:
        """The newest pair that was not read before.

        Raises:
            CamerasSilent: there was none within `max_age_ms`; says which camera is to blame.
            InputError: frames of another size than was asked for.
        """
        pair = self.read_pair()
        if self.rectify is not None:
            return StereoFrames(*self.rectify.strips(pair.left.image, pair.right.image), pair.time)
        return StereoFrames(to_tensor(pair.left.image), to_tensor(pair.right.image), pair.time)

    def read_pair(self) -> FramePair:
        limit, began = self.settings.max_age_ms / 1e3, time.monotonic()
        with self.changed:
            while True:
                now = time.monotonic()
                pair, self.pair = self.pair, None
                if pair is not None and now - pair.time <= limit:
                    break
                if now - began >= limit:
                    raise CamerasSilent(self.silence(now))
                self.changed.wait(min(limit - (now - began), 0.02))
        for side, frame in enumerate(pair):
            self.check_image(side, frame.image)
        return pair

    def silence(self, now: float) -> str:
        reasons, limit = [], self.settings.max_age_ms / 1e3
        for side, reader in enumerate(self.readers):
            frame = self.pairing.newest[side]
            if reader.trouble or frame is None or now - frame.time > limit:
                age = "no frame yet" if frame is None else f"its last frame {1e3 * (now - frame.time):.0f} ms ago"
                trouble = f": {reader.trouble}" if reader.trouble else ""
                reasons.append(f"the {SIDES[side]} camera ({reader.source.name}) gave {age}{trouble}")
        return "; ".join(reasons) or (
            f"no pair of frames for {1e3 * limit:g} ms: both cameras give frames, but more than "
            f"{self.settings.tolerance_ms:g} ms apart"
        )

    def check_image(self, side: int, image: Image) -> None:
        wide, high = self.settings.width_px, self.settings.height_px
        if image.shape[:2] != (high, wide):
            size = f"{image.shape[1]}x{image.shape[0]} frames, {wide}x{high} are wanted"
            raise InputError(
                f"the {SIDES[side]} camera ({(self.settings.left, self.settings.right)[side]}) gives {size}"
            )

    def close(self) -> None:
        for reader in self.readers:
            reader.closed.set()
        for reader in self.readers:
            reader.close()


def driver_time(capture: Capture, now: float) -> float:
    """When the frame just grabbed was taken.

    V4L2 stamps frames with the monotonic clock as they begin to arrive, and OpenCV passes that on as the
    position in ms. Anything else is no such time, and then it is now.
    """
    stamp = capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3
    return stamp if now - TRUSTED_S < stamp <= now else now


def to_tensor(image: Image) -> Tensor:
    """`[H, W, 3]` blue, green, red to `[1, 3, H, W]` red, green, blue; grey `[H, W]` to `[1, 1, H, W]`.

    The result is laid out as the image was: turning the planes inside out would cost more than navigation.
    """
    if image.ndim == 2:
        return torch.from_numpy(image)[None, None]
    return torch.from_numpy(cv2.cvtColor(image, cv2.COLOR_BGR2RGB)).permute(2, 0, 1)[None]


def open_cameras(
    settings: CameraSettings,
    rig: StereoRig,
    fields: Callable[[StereoRig], tuple[Rect, Rect]] | None = None,
    opener: Opener = open_capture,
) -> tuple[StereoCameras, StereoRig]:
    """Open both cameras; `fields` are the rectangles that navigation reads of a pair of some geometry.

    Returns:
        The cameras, and the geometry that the navigator must be made with: with a calibration, `rig` with the
        baseline and the focal length that were measured.

    Raises:
        InputError: as `StereoCameras`; a calibration that cannot be read or is of another size.
    """
    if settings.calibration is None:
        return StereoCameras(settings, opener=opener), rig
    calibration = load_calibration(settings.calibration)
    draft = Rectifier(calibration, rig)
    rectifier = Rectifier(calibration, rig, (fields or NavigatorOptions().fields)(draft.rig))
    return StereoCameras(settings, rectifier, opener), rectifier.rig
