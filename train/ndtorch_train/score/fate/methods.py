"""What is asked where patches of moving dots are: our parts and models, optical flow, background subtraction."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np
import numpy.typing as npt
import torch

import ndtorch
from ndtorch.binding.readout.common_fate import coherent_patches
from ndtorch.scenes import CommonFate
from ndtorch.vision import CoherentMotion
from ndtorch_train.score.labelled.peers import Subtraction

Mask = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]

MEMORY = 0.4
"""Seconds over which optical flow is averaged: that of our own correlations."""
STANDS_OUT = 10.0
"""Pixels a second by which averaged flow must differ from that of most pixels: a third of the dots' pace, not tuned."""
SMOOTH = 4.0
"""Deviation of the window in which it is averaged, pixels: that of our own closer look."""
ONE_WAY = 12.0
"""Pixels a second within which flow is of one patch."""
SMALLEST = 0.006
"""Smallest patch, as a share of the frame: that of our own."""


class Found(NamedTuple):
    """One thing that a method says: column and row of its place, and its pixels where it tells them."""

    place: tuple[float, float]
    mask: Mask | None


class Watching(Protocol):
    """Sees a scene frame by frame."""

    def __call__(self, scene: CommonFate, moments: Sequence[int]) -> list[list[Found]]:
        """What is found right after each of the frames `moments`, which ascend."""
        ...


def pieces(scene: CommonFate, moments: Sequence[int]) -> Iterator[torch.Tensor]:
    """The frames `[T, 3, H, W]` up to each moment in turn."""
    first = 0
    for moment in moments:
        yield scene.frames(first, moment + 1)
        first = moment + 1


def coherent(scene: CommonFate, moments: Sequence[int]) -> list[list[Found]]:
    """Correlators of all directions, and the closer look at what stands out."""
    motion, state, found = CoherentMotion(scene.size, 1 / scene.fps), None, []
    with torch.inference_mode():
        for frames in pieces(scene, moments):
            state = motion.advance(frames, state)
            found.append([Found(one.place, one.mask.numpy()) for one in coherent_patches(motion, state)])
    return found


class Model:
    """A model of ours that gives places.

    Args:
        name: of the model.
    """

    def __init__(self, name: str) -> None:
        self.name = name

    def __call__(self, scene: CommonFate, moments: Sequence[int]) -> list[list[Found]]:
        border = {"border": "reflect"} if self.name == "retinotopic" else {}
        model, state = ndtorch.load(self.name, size=scene.size, fps=scene.fps, **border), None
        found = []
        with torch.inference_mode():
            for frames in pieces(scene, moments):
                signals, state = model(frames, state)
                now = frames.shape[0] and model.in_sight(state)
                found.append([Found(one.place, self.mask(one, signals, scene.size)) for one in now or [] if one.place])
        return found

    @staticmethod
    def mask(thing: Any, signals: Any, size: tuple[int, int]) -> Mask | None:
        """The silhouette of an object, of models that have them."""
        if not hasattr(signals, "silhouettes") or not len(signals.silhouettes):
            return None
        image = (signals.silhouettes[-1].numpy() == (thing.track or 0) + 1).astype(np.uint8)
        return np.asarray(cv2.resize(image, size[::-1], interpolation=cv2.INTER_NEAREST)) > 0


class Flow:
    """Dense optical flow, averaged over a while; where it differs from most of the frame, and its clusters.

    Args:
        kind: "dis" or "farneback".
    """

    def __init__(self, kind: str) -> None:
        self.dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM) if kind == "dis" else None

    def flow(self, before: Any, now: Any) -> Any:
        """Columns and rows that every pixel moved, `[H, W, 2]`."""
        flow = np.zeros((*now.shape, 2), np.float32)
        if self.dis is not None:
            return self.dis.calc(before, now, flow)
        return cv2.calcOpticalFlowFarneback(before, now, flow, 0.5, 3, 15, 3, 5, 1.2, 0)

    def __call__(self, scene: CommonFate, moments: Sequence[int]) -> list[list[Found]]:
        before, mean, found = None, np.zeros((*scene.size, 2)), []
        share = 1 / (1 + MEMORY * scene.fps)
        for frames in pieces(scene, moments):
            for frame in (255 * frames[:, 0]).round().byte().numpy():
                if before is not None:
                    mean += share * (scene.fps * self.flow(before, frame) - mean)
                before = frame
            found.append(clusters(mean))
        return found


def clusters(flow: Floats) -> list[Found]:
    """Things in a field of velocities `[H, W, 2]`: its modes among what differs from the median, and their parts."""
    smooth = np.asarray(cv2.GaussianBlur(flow, (0, 0), SMOOTH))
    differs = smooth - np.median(smooth.reshape(-1, 2), 0)
    left = np.linalg.norm(differs, axis=-1) > STANDS_OUT
    found = []
    for _ in range(6):
        if left.sum() < SMALLEST * left.size:
            break
        some = differs[left][:: max(1, int(left.sum()) // 400)]
        near = np.linalg.norm(some[:, None] - some, axis=-1) < ONE_WAY
        mode = some[near[near.sum(1).argmax()]].mean(0)
        mask = left & (np.linalg.norm(differs - mode, axis=-1) < ONE_WAY)
        found += parts(mask)
        left &= ~mask
    return found


def parts(mask: Mask) -> list[Found]:
    """The connected parts of a mask that are large enough, after an opening and a closing."""
    square = np.ones((5, 5), np.uint8)
    clean = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, square)
    clean = cv2.morphologyEx(clean, cv2.MORPH_OPEN, square)
    count, labels, stats, middles = cv2.connectedComponentsWithStats(clean)
    return [
        Found((float(middles[n][0]), float(middles[n][1])), np.asarray(labels == n))
        for n in range(1, count)
        if stats[n, cv2.CC_STAT_AREA] >= SMALLEST * mask.size
    ]


def mog2(scene: CommonFate, moments: Sequence[int]) -> list[list[Found]]:
    """Background subtraction, opening and connected parts."""
    subtract, found = Subtraction("mog2"), []
    for frames in pieces(scene, moments):
        mask = np.zeros(scene.size, dtype=bool)
        for frame in (255 * frames).round().byte().permute(0, 2, 3, 1).numpy():
            mask, _ = subtract(np.ascontiguousarray(frame))
        found.append(parts(mask))
    return found


METHODS: dict[str, Callable[[], Watching]] = {
    "coherent": lambda: coherent,
    "retinotopic": lambda: Model("retinotopic"),
    "figures": lambda: Model("figures"),
    "dis": lambda: Flow("dis"),
    "farneback": lambda: Flow("farneback"),
    "mog2": lambda: mog2,
}
"""Every method by its name."""
