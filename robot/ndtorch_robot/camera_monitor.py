"""Camera checks: late, silent, dark, frozen, unequally lit or without content; and the mounting before a drive."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor

from ndtorch.navigation import StereoRig, Strips, cut_strips
from ndtorch_robot.ports import Fault, FaultKind, StereoFrames

Array = np.ndarray[Any, np.dtype[np.float32]]

SIDES = ("left", "right")

MOVING_M_PER_S, MOVED_FRAMES = 0.05, 2
"""Speed from which the image of the floor must change, and least equal images meanwhile of a frozen camera."""

FROZEN_S = 0.13
"""Seconds of dark or equal images after which the car stops: 4 frames at 30 Hz."""

SLOW_PERIODS = 1.6
"""Periods between two frames from which the second is late; two late frames in a row are a slow camera."""

BLOCK, SHADING_BLOCKS = 4, 8
"""Pixels of a block mean, which has little noise; blocks over which a change of brightness is shading."""

PATCH_BLOCKS, REACH_BLOCKS = 20, 60
"""Blocks of a patch that is searched in the other row, and its largest disparity."""

MIN_CORRELATION, MARGIN, MIN_PATCHES = 0.6, 0.05, 30
"""Correlation of a match, mean excess of wrong matches over right ones, and patches needed for a verdict."""

DARK_LEVELS = 3.0
"""Brightness of the brightest pixel of a row up to which a camera is dark, in levels of 255."""

ROW_CONTRAST, FIELD_CONTRAST = (1.2, 0.05), (0.6, 0.012)
"""Standard deviation of block means below which a row and a subfield show nothing: in levels, relative to the mean."""

BRIGHTNESS_RATIO = 4.0
"""Ratio of the brightness of both rows and of both subfields above which the cameras are lit unequally."""


class CameraMonitor:
    """Checks whether the car may be steered by new frames.

    At once: frames that are missing, old, ahead of the clock, not later than the last ones, or of a wrong size. After
    two late frames: a slow camera. After `FROZEN_S`: a dark row, and a subfield that stays equal to the bit while the
    car moves. After `patience_s`: images without contrast, and cameras that are lit unequally.

    Args:
        rate_hz: frames a second that the navigator relies on.
        max_age_s: age from which frames are too old.
        patience_s: time for which images must show nothing, or be unequally lit, before the car stops, s.
        rendered: Images are rendered without noise: two that stay equal together, before a blank wall, are no fault.
    """

    def __init__(
        self, rig: StereoRig, rate_hz: float, max_age_s: float, patience_s: float = 0.25, rendered: bool = False
    ) -> None:
        self.rig, self.rate_hz, self.max_age_s, self.rendered = rig, rate_hz, max_age_s, rendered
        self.frozen_frames = max(2, round(FROZEN_S * rate_hz))
        self.patience = max(2, round(patience_s * rate_hz))
        self.time = -math.inf
        self.reset()

    def reset(self) -> None:
        """Forget earlier images: a person resumes the car, and may have corrected the cameras."""
        self.last: list[Tensor | None] = [None, None]
        self.dark, self.equal, self.moved, self.blank = [0, 0], [0, 0], [0, 0], [0, 0]
        self.unequal = self.late = 0

    def judge(self, frames: StereoFrames, speed: float, now: float) -> Fault | None:
        """What is wrong with frames; `speed` is that since the last ones, m/s, `now` is on their clock, s."""
        fault = self.judge_times(frames.time, now)
        if fault is not None:
            return fault
        pair = []
        for k, image in enumerate(frames[:2]):
            if isinstance(image, Tensor):
                if image.shape[-2:] != (self.rig.height, self.rig.width):
                    size = f"{image.shape[-1]}x{image.shape[-2]} frames, {self.rig.width}x{self.rig.height} are wanted"
                    return Fault(FaultKind.SHAPE, f"the {SIDES[k]} camera gives {size}")
                image = cut_strips(image, self.rig.subfields()[k], self.rig)
            pair.append(image)
        left, right = pair
        if left.row.shape != right.row.shape or left.row.dtype != right.row.dtype:
            kinds = " and ".join(f"{each.row.dtype} {tuple(each.row.shape)}" for each in pair)
            return Fault(FaultKind.SHAPE, f"left and right frames must be alike, got rows of {kinds}")
        fault = self.judge_pixels(pair, abs(speed) > MOVING_M_PER_S) or self.judge_contrast(pair)
        if fault is None and self.late >= 2:
            rate = f"less than {self.rate_hz / SLOW_PERIODS:.0f} frames a second, {self.rate_hz:.0f} are wanted"
            return Fault(FaultKind.SLOW, f"the cameras give {rate}")
        return fault

    def judge_times(self, time: float, now: float) -> Fault | None:
        if not math.isfinite(time) or time > now + 0.01:
            return Fault(FaultKind.TIMES, f"the time of the frames is {time - now:.3f} s ahead")
        before, self.time = self.time, max(time, self.time)
        if now - time > self.max_age_s:
            return Fault(FaultKind.AGE, f"the frames are {now - time:.3f} s old")
        if time <= before:
            return Fault(FaultKind.TIMES, f"times of frames must increase, got {time:.3f} s after {before:.3f} s")
        self.late = self.late + 1 if SLOW_PERIODS / self.rate_hz < time - before < math.inf else 0
        return None

    def judge_pixels(self, pair: list[Strips], moving: bool) -> Fault | None:
        same = [old is not None and torch.equal(old, new.field) for old, new in zip(self.last, pair, strict=True)]
        self.last = [each.field for each in pair]
        for k, (field, row) in enumerate(pair):
            darkest = DARK_LEVELS / (1 if row.dtype == torch.uint8 else 255)
            self.dark[k] = self.dark[k] + 1 if float(row.max()) <= darkest else 0
            equal = same[k] and not (self.rendered and all(same))
            if equal:  # a wall of one color that fills the subfield looks the same from everywhere
                equal = bool((field.amax((-2, -1)) > field.amin((-2, -1))).any())
            # A car may stand between two directions: all equal images count, but some must come while it moves.
            self.equal[k], self.moved[k] = (self.equal[k] + 1, self.moved[k] + moving) if equal else (0, 0)
            if self.dark[k] >= self.frozen_frames:
                return Fault(FaultKind.BLACK, f"the {SIDES[k]} camera has been black for {self.dark[k]} frames")
            if self.equal[k] >= self.frozen_frames and self.moved[k] >= MOVED_FRAMES:
                words = f"the {SIDES[k]} camera has given the same image for {self.equal[k]} frames"
                return Fault(FaultKind.FROZEN, words)
        return None

    def judge_contrast(self, pair: list[Strips]) -> Fault | None:
        means = []
        for k, (field, row) in enumerate(pair):
            row_blocks, field_blocks = blocks(row, 1), blocks(field, BLOCK)
            row_mean, field_mean = float(row_blocks.mean()), float(field_blocks.mean())
            row_shows = detail(row_blocks) >= max(ROW_CONTRAST[0], ROW_CONTRAST[1] * row_mean)
            shows = row_shows or detail(field_blocks) >= max(FIELD_CONTRAST[0], FIELD_CONTRAST[1] * field_mean)
            self.blank[k] = max(self.blank[k] - 1, 0) if shows else min(self.blank[k] + 1, self.patience)
            if self.blank[k] >= self.patience:
                return Fault(FaultKind.BLANK, f"the {SIDES[k]} camera shows nothing at level {row_mean:.0f} of 255")
            means.append((row_mean + 1, field_mean + 1))
        ratios = [max(a / b, b / a) for a, b in zip(*means, strict=True)]
        unequal = min(ratios) > BRIGHTNESS_RATIO
        self.unequal = min(self.unequal + 1, self.patience) if unequal else max(self.unequal - 1, 0)
        if self.unequal < self.patience:
            return None
        return Fault(FaultKind.UNEQUAL, f"one camera is {min(ratios):.1f} times as bright as the other")


def blocks(image: Tensor, high: int) -> Array:
    """Block means `[h / high, w / 4]` in levels of the green or only color of `[..., C, h, w]`."""
    plane = image.reshape(-1, *image.shape[-3:])[-1, image.shape[-3] // 2]
    pixels: Array = plane.numpy().astype(np.float32) * (1 if image.dtype == torch.uint8 else 255)
    high, wide = min(high, pixels.shape[0]), min(BLOCK, pixels.shape[1])
    rows, columns = pixels.shape[0] // high, pixels.shape[1] // wide
    means: Array = pixels[: rows * high, : columns * wide].reshape(rows, high, columns, wide).mean((1, 3))
    return means


def detail(means: Array) -> float:
    """Standard deviation of block means without shading, such as that of a hand before the lens."""
    lag = min(SHADING_BLOCKS if len(means) == 1 else SHADING_BLOCKS // 2, (means.shape[1] - 1) // 4)
    if lag > 0:
        return float((means[:, lag:-lag] - (means[:, : -2 * lag] + means[:, 2 * lag :]) / 2).std())
    return float(means.std())


def mounting_fault(pairs: Iterable[StereoFrames], rig: StereoRig) -> str | None:
    """What is wrong with the mounting of two cameras: swapped, crossed or upside down; None where nothing is.

    With parallel cameras matches lie further to the left in the right row. Patches of the left row are searched on
    either side, and mirrored.

    Args:
        pairs: of a car that is moved about in a place with edges; a few seconds of them.
    """
    excess: list[tuple[float, float]] = []
    for frames in pairs:
        rows = []
        for image, field in zip(frames[:2], rig.subfields(), strict=True):
            strips = image if isinstance(image, Strips) else cut_strips(image, field, rig)
            rows.append(np.ascontiguousarray(blocks(strips.row, 1)))
        left, right = rows
        for start in range(0, left.shape[1] - PATCH_BLOCKS + 1, PATCH_BLOCKS // 2):
            patch = left[:, start : start + PATCH_BLOCKS]
            if patch.std() < max(1.2, 0.02 * float(left.mean())):
                continue
            straight, mirrored = (
                cv2.matchTemplate(right, np.ascontiguousarray(part), cv2.TM_CCOEFF_NORMED)[0]
                for part in (patch, patch[:, ::-1])
            )
            ahead = straight[max(0, start - REACH_BLOCKS) : start + 1].max()
            wrong = straight[start + 2 : start + 1 + REACH_BLOCKS].max(initial=-1)
            opposite = len(mirrored) - 1 - start
            turned = mirrored[max(0, opposite - REACH_BLOCKS) : opposite + 1 + REACH_BLOCKS].max()
            if max(ahead, wrong, turned) >= MIN_CORRELATION:
                excess.append((float(wrong - ahead), float(turned - max(ahead, wrong))))
    if len(excess) < MIN_PATCHES:
        return "the cameras show too few edges to compare them: move the car about in a furnished place"
    swapped, mirrored = np.mean(excess, 0)
    if mirrored > MARGIN:
        return "one of the cameras is upside down: the rows match when one is mirrored"
    if swapped > MARGIN:
        return "the cameras are swapped, crossed or both upside down: matches lie on the wrong side"
    return None
