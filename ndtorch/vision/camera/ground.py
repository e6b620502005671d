"""What the ground of a picture is told by: constants, state, and a few pixels that stand for all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from pydantic import Field
from torch import Tensor

from ndtorch.config import Constants

Floats = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]
Bytes = npt.NDArray[np.uint8]
MEAN_SIZE, MEDIAN_SIZE = 0.798, 0.6745
"""Mean magnitude of a normal variable against its standard deviation, and median of its magnitude likewise."""


class GroundParams(Constants):
    """Constants of figure and ground; brightness as a share of full scale, times in seconds."""

    height: int = Field(
        224, ge=16, le=32_768, description="most rows of the image on which figures are told from the ground"
    )
    tau_ground: float = Field(10.0, gt=0, description="memory of the background")
    tau_noise: float = Field(4.0, gt=0, description="memory of the noise of every pixel")
    spread: float = Field(3.0, gt=0, description="standard deviations of the noise that count as standing out")
    least_noise: float = Field(0.006, gt=0, description="smallest standard deviation of the noise")
    moved: float = Field(0.012, gt=0, description="smallest change from picture to picture that is motion")
    still: float = Field(0.5, ge=0, description="what has not moved for this long is ground, or a hole in memory,")
    settle: float = Field(2.0, gt=0, description="for less, by and by, where nothing was still so long until then")
    broad: float = Field(0.06, ge=0, description="smallest side of what moves there, as a share of the height")
    trail: float = Field(0.1, ge=0, description="what moved so long ago stands out where the ground is not known")
    hold: float = Field(0.05, ge=0, description="pace of the background where an object is, as a share")
    darkest: float = Field(0.3, ge=0, le=1, description="a shadow leaves at least this share of the light,")
    tint: float = Field(0.12, ge=0, description="changes the colors' shares by at most this,")
    uneven: float = Field(0.06, ge=0, description="and its own share varies by at most this among neighbours")
    penumbra: int = Field(2, ge=0, description="width of a shadow's edge, pixels of that image")
    around: float = Field(0.04, ge=0, description="what lies within this between parts that are no shadow is none")
    pure: float = Field(0.05, ge=0, description="and a narrow one changes the colors' shares by less,")
    colored: float = Field(0.03, ge=0, description="which says something where the ground's colors are so far apart")
    gain_limit: float = Field(4.0, ge=1, description="largest gain of the exposure, and 1 / the smallest")
    dark: float = Field(0.04, ge=0, lt=1, description="the exposure is told where the ground is lighter than this,")
    light: float = Field(0.1, ge=0, le=1, description="and only where that is at least this share of the picture")
    offset: float = Field(0.02, gt=0, description="added to both before the light of a shadow is a ratio")
    patch: int = Field(5, ge=1, description="side of what counts as neighbours, pixels of that image")
    speckle: int = Field(3, ge=1, description="side of the window in which most must stand out, and of what is left")
    surprise: float = Field(3.0, gt=0, description="the noise learns no more at a time than so many times itself")
    soft: int = Field(3, ge=1, description="side of the window that smooths pictures before motion is told")
    cut: float = Field(0.7, gt=0, le=1, description="share of the picture standing out that makes it a new scene,")
    block: int = Field(8, ge=1, description="or means of blocks of so many pixels, where noise is little:")
    changed: float = Field(0.6, gt=0, le=1, description="more than this share of them differs from those before")
    other: float = Field(0.02, gt=0, description="by more than this,")
    alike: float = Field(0.25, ge=-1, le=1, description="and their correlation with those before is below this")


class GroundState(NamedTuple):
    """What changes: background, mean deviation from it, and the picture before, blurred, `[3, h, w]`; how much that
    changes from picture to picture, seconds since something moved, and whether the ground is known, 1 or 0, `[h, w]`;
    and frames seen since it began, `[]`."""

    mean: Tensor
    deviation: Tensor
    before: Tensor
    restless: Tensor
    quiet: Tensor
    known: Tensor
    frames: Tensor


@dataclass
class Ground:
    """A `GroundState` as arrays of its own, which each step of a call changes in place, and room for a step's pictures:
    the attributes are those of the state."""

    mean: Floats
    deviation: Floats
    before: Floats
    restless: Floats
    quiet: Floats
    known: Floats
    frames: int

    def __post_init__(self) -> None:
        shape = self.mean.shape
        self.picture, self.soft, (self.grey, self.light) = room(*shape), room(*shape), room(2, *shape[1:])
        self.marks = np.empty((5, *shape[1:]), np.uint8)

    @classmethod
    def of(cls, state: GroundState) -> Ground:
        """A copy of a state."""
        mean, deviation, before, restless, quiet, known = (copied(part) for part in state[:6])
        return cls(mean, deviation, before, restless, quiet, known, int(state.frames))

    def state(self) -> GroundState:
        """What there is now, as tensors that share its memory."""
        planes = (self.mean, self.deviation, self.before, self.restless, self.quiet, self.known)
        mean, deviation, before, restless, quiet, known = (torch.from_numpy(plane) for plane in planes)
        frames = torch.tensor(self.frames, dtype=torch.int64)
        return GroundState(mean, deviation, before, restless, quiet, known, frames)


def room(*shape: int) -> Floats:
    """Memory for numbers. It begins where a vector does: what NumPy gives does not, and takes up to a third longer."""
    return np.asarray(torch.empty(shape).numpy())


def copied(state: Tensor) -> Floats:
    """An array of its own with the numbers of a tensor."""
    copy = room(*state.shape)
    copy[...] = state.numpy()
    return copy


def grey_of(picture: Floats) -> Floats:
    """The mean of the colors, `[h, w]`."""
    grey: Floats = (picture[0] + picture[1] + picture[2]) * np.float32(1 / 3)
    return grey


def some_of(images: Floats) -> Floats:
    """About every sixteenth pixel of `[C, h, w]`, counted from all four corners, `[C, n]`.

    Those of a mirror image are the same, and so is all that is told from them.
    """
    rows, columns = ((n + 1) // 2 for n in images.shape[1:])
    turned = (images, images[:, ::-1], images[:, :, ::-1], images[:, ::-1, ::-1])
    return np.concatenate([one[:, :rows:4, :columns:4].reshape(len(images), -1) for one in turned], 1)


def medians(rows: Floats) -> Floats:
    """Median of each row; `np.median` takes several times as long for rows as short as these."""
    half = rows.shape[1] // 2
    if rows.shape[1] % 2:
        return np.asarray(np.partition(rows, half, axis=1)[:, half])
    both = np.partition(rows, (half - 1, half), axis=1)[:, half - 1 : half + 1]
    return np.asarray(both.mean(1))
