"""Clips in which nothing is there but weather, light, and what is near the camera, drawn over one still picture."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ndtorch.errors import InputError
from ndtorch.scenes.quiet import quiet_opencv
from ndtorch_train.score.choices import Split
from ndtorch_train.score.labelled.nearby import noise, screen, shake
from ndtorch_train.score.labelled.sight import Clip, Pixels
from ndtorch_train.score.labelled.truth import Labelled
from ndtorch_train.score.labelled.weather import FPS, Chance, Floats, leaves, light, nightfall, rain, snow, water

SEEDS: dict[Split, int] = {"tune": 0, "test": 1_000_000}

SAMPLES = 25
"""Frames of a video whose median is its still picture."""

KINDS: dict[str, Callable[[Floats, Chance, int], Iterator[Floats]]] = {
    "noise": noise,
    "rain": rain,
    "light": light,
    "leaves": leaves,
    "snow": snow,
    "water": water,
    "nightfall": nightfall,
    "shake": shake,
    "screen": screen,
}


@dataclass(frozen=True)
class Drawn:
    """The frames of such a clip; every loop over them draws the same again."""

    kind: str
    still: Pixels
    seed: int
    count: int

    def __iter__(self) -> Iterator[Pixels]:
        still = self.still.astype(np.float32) / np.float32(255)
        # One more number, so that no two kinds have the same chance.
        chance = np.random.default_rng((self.seed, list(KINDS).index(self.kind)))
        for frame in KINDS[self.kind](still, chance, self.count):
            yield (frame * np.float32(255) + np.float32(0.5)).clip(0, 255).astype(np.uint8)


def empty_clips(source: Path, seconds: float, split: Split) -> list[Labelled]:
    """One clip of each kind over a picture, or the median of a video.

    Raises:
        InputError: no picture there, or a time out of range.
    """
    if not 1 <= seconds <= 3600:
        raise InputError(f"empty-seconds must lie between 1 and 3600, got {seconds:g}")
    still = still_picture(source)
    count = round(seconds * FPS)
    return [
        Labelled(Clip(kind, Drawn(kind, still, SEEDS[split], count), FPS, still.shape[:2]), "none", source)
        for kind in KINDS
    ]


def still_picture(source: Path) -> Pixels:
    """A picture, or the median of frames of a video, in which what passes is gone, blue, green, red.

    Raises:
        InputError: neither.
    """
    if not source.is_file():
        raise InputError(f"{source}: no such file")
    with quiet_opencv():
        picture = cv2.imread(str(source))
    if picture is None:
        picture = median_frame(source)
    if picture is None or min(picture.shape[:2]) < 32:
        raise InputError(f"{source} is no picture or video of 32 x 32 pixels or more")
    return np.asarray(picture, np.uint8)


def median_frame(path: Path) -> Pixels | None:
    """The median of frames all over a video, pixel by pixel; None where there are none."""
    with quiet_opencv():
        capture = cv2.VideoCapture(str(path))
        step = max(1, int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) // SAMPLES)
        frames, number = [], 0
        while capture.grab():
            if number % step == 0:
                there, frame = capture.retrieve()
                frames += [frame] if there else []
            number += 1
        capture.release()
    return np.median(np.stack(frames), 0).astype(np.uint8) if frames else None
