"""The pair of cameras as the loop sees it, rectified where there is a calibration."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Protocol

import torch
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.navigation import Rect, StereoRig, Strips
from ndtorch.navigation.options import NavigatorOptions
from ndtorch.navigation.stereo.calibration_files import load_calibration
from ndtorch_robot.cameras.pairing import Frame, Pair, Pairing, PairStatistics
from ndtorch_robot.cameras.reader import CameraReader, frame_rate
from ndtorch_robot.cameras.source import CameraSettings, Capture, Image, Opener, Source, find_source, open_capture
from ndtorch_robot.cameras.sources.v4l2 import place_of
from ndtorch_robot.ports import Closing, StereoFrames

SIDES = ("left", "right")

FIRST_FRAME = 5.0
"""Seconds within which a camera must give its first frame; some take two to switch on."""


class CamerasSilent(InputError):
    """No pair of frames came in time. Reading may be tried again: cameras come back."""


class FramesEnded(InputError):
    """A file or folder has no more frames."""


class Rectify(Protocol):
    """Makes the strips that navigation reads out of two raw images."""

    def strips(self, left: Image, right: Image) -> tuple[Strips, Strips]:
        """`Strips` of `[1, C, h, w]` uint8 of both eyes."""
        ...


class StereoCameras(Closing):
    """Two cameras that run freely, one reader thread each; implements `ndtorch_robot.ports.CameraPair`.

    Each reading gives the newest pair that has not been read yet, and waits for it when it must. The time of a
    pair is that of its older frame. Frames are whole ones `[1, C, H, W]` uint8, red, green, blue, or with
    `rectify` the corrected strips.

    Args:
        settings: both sources, and what is wanted of them.
        rectify: `ndtorch_robot.calibration.Rectifier`.
        opener: opens one source; for tests.

    Raises:
        InputError: a source that cannot be opened or gives no frames or ones of another size, two files of
            different length, or a calibration of another size.
    """

    def __init__(self, settings: CameraSettings, rectify: Rectify | None = None, opener: Opener = open_capture) -> None:
        self.settings, self.rectify = settings, rectify
        if settings.calibration is not None and rectify is None:
            raise InputError(f"cameras with calibration {settings.calibration} must be opened by open_cameras")
        self.sources = (find_source(settings.left), find_source(settings.right))
        if self.sources[0].live and self.sources[0].target == self.sources[1].target:
            raise InputError(f"left and right are the same camera, {settings.left}")
        self.changed = threading.Condition()
        self.pairing = Pairing(settings.tolerance_ms / 1e3)
        self.pair: Pair | None = None
        self.count = self.seen = 0
        self.played: list[Capture] = []
        self.readers: list[CameraReader] = []
        self.begun = False
        try:
            if settings.pace == "read" and not any(source.live for source in self.sources):
                self.played = [opener(source, settings) for source in self.sources]
                self.check_lengths(self.played)
            else:
                self.start(opener)
        except BaseException:
            self.close()
            raise

    def start(self, opener: Opener) -> None:
        """Open both, and start the readers of cameras, the right one when the left one gives frames.

        Files begin to play when they are first read: who reads may have to get ready before.
        """
        for side, source in enumerate(self.sources):
            reader = CameraReader(source, self.settings, opener, partial(self.add, side))
            self.readers.append(reader)
        captures = [reader.capture for reader in self.readers if reader.capture is not None]
        self.check_lengths(captures)
        if any(source.live for source in self.sources):
            self.begin(one_after_the_other=True)

    def begin(self, one_after_the_other: bool = False) -> None:
        """Let the readers run; which camera does not come is told by one after the other."""
        start = time.monotonic() + 0.05
        for side, reader in enumerate(self.readers):
            reader.due = start
            reader.thread.start()
            if one_after_the_other:
                self.wait_for_first(side)
        self.begun = True

    def check_lengths(self, captures: list[Capture]) -> None:
        """Two folders must hold as many images; what a video says of its length is not always true."""
        import cv2

        counts = [round(capture.get(cv2.CAP_PROP_FRAME_COUNT)) for capture in captures]
        if all(source.kind == "folder" for source in self.sources) and counts[0] != counts[1]:
            raise InputError(
                f"left and right folder must hold as many images, got {counts[0]} in {self.sources[0].name} "
                f"and {counts[1]} in {self.sources[1].name}"
            )

    def wait_for_first(self, side: int) -> None:
        """Wait until a camera gives its first frame; its size is checked as it comes."""
        reader = self.readers[side]
        with self.changed:
            until = time.monotonic() + FIRST_FRAME
            while self.pairing.newest[side] is None and not (reader.trouble or reader.ended):
                if not self.changed.wait(min(0.1, max(0.0, until - time.monotonic()))) and time.monotonic() > until:
                    break
            frame = self.pairing.newest[side]
        if frame is None:
            raise InputError(self.no_first_frame(side))
        self.check_image(side, frame.image)

    def no_first_frame(self, side: int) -> str:
        name = f"the {SIDES[side]} camera ({self.sources[side].name})"
        if side == 1 and all(source.kind == "device" for source in self.sources):
            places = [place_of(source.target) for source in self.sources]
            if places[0] is not None and places[1] is not None and places[0].bus == places[1].bus:
                return (
                    f"{name} opens but gives no frame while the left one runs: both are on USB bus {places[0].bus} "
                    f"({places[0].speed:g} Mbit/s), which has no room for two. Plug one of them into another bus "
                    f"(`lsusb -t` shows them), or use fourcc MJPG, a smaller size or a lower rate"
                )
        return f"{name} opens but gives no frame ({self.readers[side].trouble or 'nothing for 5 s'})"

    def add(self, side: int, frame: Frame) -> None:
        with self.changed:
            pair = self.pairing.add(side, frame)
            if pair is not None:
                if self.count > self.seen:
                    self.pairing.statistics.unread += 1
                self.pair, self.count = pair, self.count + 1
            self.changed.notify_all()

    def read(self) -> StereoFrames:
        """The newest pair that was not read before.

        Raises:
            CamerasSilent: there was none within `max_age_ms`; says which camera is to blame.
            FramesEnded: a file is at its end.
            InputError: frames of another size than was asked for.
        """
        return self.convert(self.read_pair())

    def read_pair(self) -> Pair:
        """As `read`, but the two images as they came, with their times."""
        pair = self.next_images() if self.played else self.next_pair()
        for side, frame in enumerate(pair):
            self.check_image(side, frame.image)
        return pair

    def next_pair(self) -> Pair:
        if not self.begun:
            self.begin()
        limit = self.settings.max_age_ms / 1e3
        began = time.monotonic()
        with self.changed:
            while True:
                now = time.monotonic()
                if self.pair is not None and self.count > self.seen and now - self.pair.time <= limit:
                    self.seen = self.count
                    return self.pair
                for side, reader in enumerate(self.readers):
                    if reader.ended and self.count == self.seen and not self.awaited(side):
                        raise FramesEnded(f"{SIDES[side]} {self.sources[side].name} ended after {reader.frames} frames")
                if now - began >= limit:
                    raise CamerasSilent(self.silence(now))
                self.changed.wait(min(limit - (now - began), 0.02))

    def awaited(self, side: int) -> bool:
        """Whether the last frame of a file waits for that of the other file."""
        other, frame, newest = self.readers[1 - side], self.pairing.newest[side], self.pairing.newest[1 - side]
        if frame is None or not self.pairing.free[side] or other.ended or other.source.live:
            return False
        return newest is None or newest.time < frame.time

    def next_images(self) -> Pair:
        """The next frame of both files; the time is that of playing at their rate."""
        images, number = [], self.count
        for side, capture in enumerate(self.played):
            good, image = capture.retrieve() if capture.grab() else (False, None)
            if not good or image is None:
                raise FramesEnded(f"{SIDES[side]} {self.sources[side].name} ended after {number} frames")
            images.append(image)
        self.count = self.seen = number + 1
        when = number / frame_rate(self.played[0], self.sources[0], self.settings)
        left, right = (Frame(image, when, when) for image in images)
        for side, frame in enumerate((left, right)):
            self.pairing.add(side, frame)
        return Pair(left, right)

    def silence(self, now: float) -> str:
        reasons = []
        limit = self.settings.max_age_ms / 1e3
        for side, reader in enumerate(self.readers):
            frame = self.pairing.newest[side]
            age = now - frame.time if frame is not None else now
            if reader.trouble or frame is None or age > limit:
                since = "gave no frame yet" if frame is None else f"gave its last frame {1e3 * age:.0f} ms ago"
                reasons.append(
                    f"the {SIDES[side]} camera ({self.sources[side].name}) {since}"
                    + (f": {reader.trouble}" if reader.trouble else "")
                )
        if reasons:
            return "; ".join(reasons)
        left, right = self.pairing.newest
        assert left is not None
        assert right is not None
        return (
            f"no pair of frames for {self.settings.max_age_ms:g} ms: both cameras give frames, the newest are "
            f"{1e3 * abs(left.time - right.time):.0f} ms apart and {self.settings.tolerance_ms:g} ms are allowed"
        )

    def check_image(self, side: int, image: Image) -> None:
        """Raise `InputError` for a frame of another size."""
        s = self.settings
        if image.shape[:2] != (s.height_px, s.width_px):
            raise InputError(
                f"the {SIDES[side]} camera ({self.sources[side].name}) gives {image.shape[1]}x{image.shape[0]} frames, "
                f"{s.width_px}x{s.height_px} are wanted"
            )

    def convert(self, pair: Pair) -> StereoFrames:
        images = (pair.left.image, pair.right.image)
        if self.rectify is not None:
            left, right = self.rectify.strips(*images)
            return StereoFrames(left, right, pair.time)
        return StereoFrames(to_tensor(images[0]), to_tensor(images[1]), pair.time)

    def statistics(self) -> PairStatistics:
        with self.changed:
            return self.pairing.statistics.copy()

    def close(self) -> None:
        for reader in self.readers:
            reader.closed.set()
        for reader in self.readers:
            reader.close()
        for capture in self.played:
            capture.release()


def to_tensor(image: Image) -> Tensor:
    """`[H, W, 3]` blue, green, red to `[1, 3, H, W]` red, green, blue; grey `[H, W]` to `[1, 1, H, W]`.

    The result is laid out as the image was: turning the planes inside out would cost more than navigation.
    """
    import cv2

    if image.ndim == 2:
        return torch.from_numpy(image)[None, None]
    return torch.from_numpy(cv2.cvtColor(image, cv2.COLOR_BGR2RGB)).permute(2, 0, 1)[None]


def probe_size(source: Source, settings: CameraSettings) -> tuple[int, int]:
    capture = open_capture(source, settings)
    try:
        good, image = capture.retrieve() if capture.grab() else (False, None)
    finally:
        capture.release()
    if not good or image is None:
        raise InputError(f"camera {source.name}: none of its frames can be decoded")
    return image.shape[1], image.shape[0]


def open_cameras(
    settings: CameraSettings,
    rig: StereoRig,
    fields: Callable[[StereoRig], tuple[Rect, Rect]] | None = None,
    opener: Opener = open_capture,
) -> tuple[StereoCameras, StereoRig]:
    """Open both cameras.

    Args:
        rig: where they are on the car.
        fields: the rectangles that navigation reads of a pair of this geometry; the default navigator's by default.

    Returns:
        The cameras, and the geometry that the navigator must be made with: with a calibration, `rig` with the
        baseline and the focal length that were measured.

    Raises:
        InputError: as `StereoCameras`; a calibration that cannot be read or is of another size.
    """
    if settings.calibration is None:
        return StereoCameras(settings, opener=opener), rig
    from ndtorch_robot.calibration import Rectifier

    calibration = load_calibration(settings.calibration)
    draft = Rectifier(calibration, rig)
    rectifier = Rectifier(calibration, rig, (fields or NavigatorOptions().fields)(draft.rig))
    return StereoCameras(settings, rectifier, opener), rectifier.rig
