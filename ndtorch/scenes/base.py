"""What every source of frames offers, checks that scenes share, and scenes computed from the number of a frame."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
import torch
from torch import Tensor

from ndtorch.arguments import check_number, check_size, is_finite, is_whole
from ndtorch.errors import InputError
from ndtorch.utils.tensors import keep_freed_memory


class PixelMap(NamedTuple):
    """From pixels of the frames that a source delivers to pixels of its own frames: `scale * x + left`."""

    scale_x: float = 1.0
    scale_y: float = 1.0
    left: float = 0.0
    top: float = 0.0

    def points(self, places: Any) -> Any:
        """Places `[N, 2 k]`, columns and rows in turn."""
        pairs = np.asarray(places, np.float64)
        turns = pairs.shape[-1] // 2
        scale, first = [self.scale_x, self.scale_y] * turns, [self.left, self.top] * turns
        return pairs * scale + first


SAME_PIXELS = PixelMap()
"""Of a source that delivers its frames as they are."""


class SourceFrames(NamedTuple):
    """The decoded frames of a source, from its first on: frame n is the n-th that any reader of it counts.

    Attributes:
        stamp: seconds as the source has them, `[n]`.
        tick: place on the clock of the frames that were delivered, `[n]`: whole where a frame was shown first, between
            the neighbors where it was left out, NaN before the first frame that was asked for.
        names: file names, of a folder.
    """

    stamp: np.ndarray[Any, np.dtype[np.float64]]
    tick: np.ndarray[Any, np.dtype[np.float64]]
    names: Sequence[str] | None = None


class FrameSource(ABC):
    """Frames in order: a simulated scene, a video, a folder of images or a camera.

    Attributes:
        name: short name, fit for a folder name.
        fps: frames per second.
        size: height and width of a frame in pixels.
        length: number of frames, or None where it is unknown (a camera).
        pixel_map: from pixels of the frames delivered to those of the source's own frames, which a video may shrink.
        cuts: seconds at which the source itself jumps to another time.
        silent: why a camera or stream ended; empty while it goes on, and of others.
    """

    name: str
    fps: float
    size: tuple[int, int]
    length: int | None
    pixel_map: PixelMap = SAME_PIXELS
    cuts: Sequence[float] = ()
    silent: str = ""

    @staticmethod
    def from_array(frames: Any, fps: float, name: str = "array") -> FrameSource:
        """A source of frames of your own.

        Args:
            frames: a tensor or array `[..., T, C, H, W]`, or `[..., T, H, W, C]` of C = 1 or 3, float 0..1 or uint8;
                or an iterable of frames `[C, H, W]` or `[H, W, C]`, such as a generator, which can be read once.
            fps: frames a second.
            name: short name, fit for a folder name.

        >>> source = FrameSource.from_array((torch.full((3, 8, 8), n / 10) for n in range(10)), fps=25)
        >>> [len(chunk) for chunk in source.chunks(4)]
        [4, 4, 2]
        """
        return ArraySource(frames, fps, name)

    @property
    def full_size(self) -> tuple[int, int]:
        """Height and width of the source's own frames, upright."""
        return self.size

    @property
    def decoded(self) -> SourceFrames | None:
        """The frames of the source that the latest reading decoded; None where every frame is delivered, as it is."""
        return None

    def latest(self) -> list[np.ndarray[Any, np.dtype[np.uint8]]]:
        """Frames of the latest chunk, as large as the source has them, `[H, W, 3]` uint8; none where they are not
        larger."""
        return []

    @abstractmethod
    def chunks(self, frames: int = 8, start: int = 0) -> Iterator[Tensor]:
        """Yield `[..., T, 3, H, W]` with T <= `frames`, from frame number `start` on, until the source ends.

        Values are in 0..1 (float) or 0..255 (uint8). Every yielded tensor is the caller's to keep.
        A few frames at a time are fastest on a CPU: 500x500 RGB frames leave the cache after one or two.
        """


class ArraySource(FrameSource):
    """Frames of an array or of an iterable, see `FrameSource.from_array`."""

    def __init__(self, frames: Any, fps: float, name: str) -> None:
        check_number("fps", fps, above=0, unit="frames a second")
        self.name, self.fps = name, float(fps)
        each = planes(frames, 4).unbind(-4) if hasattr(frames, "shape") else frames
        self.length = len(each) if isinstance(each, list | tuple) else None
        left = iter(each)
        first = next(left, None)
        if first is None:
            raise InputError("frames must be one or more")
        self._each: Iterable[Any] = itertools.chain([first], left) if self.length is None else each
        height, width = planes(first, 3).shape[-2:]
        self.size = (height, width)

    def chunks(self, frames: int = 8, start: int = 0) -> Iterator[Tensor]:
        check_chunks(frames, start)
        rest = map(planes, itertools.islice(self._each, start, None), itertools.repeat(3))
        return (torch.stack(some, -4) for some in iter(lambda: list(itertools.islice(rest, frames)), []))


def planes(frames: Any, dims: int) -> Tensor:
    """Frames with their colors before rows and columns."""
    try:
        image = torch.as_tensor(frames)
    except (TypeError, ValueError, RuntimeError) as error:
        raise InputError(f"frames must be tensors or arrays, got {type(frames).__name__}") from error
    if image.ndim < dims or not {image.shape[-3], image.shape[-1]} & {1, 3}:
        shape = "[..., T, C, H, W]" if dims == 4 else "[C, H, W]"
        raise InputError(f"frames must be of shape {shape} with 1 or 3 colors, got {tuple(image.shape)}")
    return image if image.shape[-3] in (1, 3) else image.movedim(-1, -3)


Made = TypeVar("Made")

PerScene = float | Sequence[float] | Tensor
"""One number, or B numbers for a batch of B scenes."""

PerBar = float | Sequence[float] | Sequence[Sequence[float]] | Tensor
"""One number for all, one a bar `[bars]`, or one a scene and bar `[B, bars]`."""


def check_seed(seed: object) -> None:
    """Raise `InputError` unless it is a whole number, or several."""
    several = seed if isinstance(seed, tuple | list) else (seed,)
    if not several or not all(is_whole(one) and abs(one) < 2**63 for one in several):
        raise InputError(f"seed must be a whole number or several, got {repr(seed)[:40]}")


def for_each_scene(make: Callable[..., Made], **values: PerScene) -> Made | list[Made]:
    """What `make` gives of the values of one scene, or of B scenes where some of them hold B values."""
    each = (numbers(name, one, 1).numpy() for name, one in values.items())
    try:
        rows = np.stack(np.broadcast_arrays(*each), -1)
    except ValueError as error:
        raise InputError(f"{' and '.join(values)} must hold equally many values") from error
    return make(*rows.tolist()) if rows.ndim == 1 else [make(*row) for row in rows.tolist()]


def numbers(name: str, value: object, most_dims: int, least_dims: int = 0) -> Tensor:
    """A float64 tensor of so many dimensions on the CPU, or `InputError`."""
    wanted = "finite numbers: one, " + ("or a list of them" if most_dims == 1 else "or one for each bar or scene")
    try:
        tensor = torch.as_tensor(value, dtype=torch.float64).cpu()
    except (TypeError, ValueError, OverflowError, RuntimeError) as error:
        raise InputError(f"{name} must be {wanted}, got {repr(value)[:40]}") from error
    if tensor.ndim > most_dims or tensor.numel() == 0 or not bool(torch.isfinite(tensor).all()):
        raise InputError(f"{name} must be {wanted}, got {tensor.tolist()}")
    return tensor.reshape(1) if tensor.ndim < least_dims else tensor


MOST_FPS, MOST_SECONDS = 1e5, 1e8
"""Frames a second and seconds of the fastest and the longest scene."""


class RenderedScene(FrameSource):
    """A simulated scene: frame n depends on n alone and comes out the same in whatever chunk it is.

    Args:
        name: short name, fit for a folder name.
        seconds: duration; the length is `round(seconds * fps)` frames, at least one.
        fps: frames per second.
        size: height and width in pixels.
        device: where the frames are computed.

    Raises:
        InputError: a duration, rate or size that is not positive and finite.
    """

    length: int

    def __init__(
        self, name: str, seconds: float, fps: float, size: tuple[int, int], device: torch.device | str = "cpu"
    ) -> None:
        if not (is_finite(fps) and 0 < fps <= MOST_FPS):
            raise InputError(f"fps must be a positive number of frames per second, got {repr(fps)[:40]}")
        if not (is_finite(seconds) and 0 < seconds <= MOST_SECONDS):
            raise InputError(f"seconds must be a positive number, {MOST_SECONDS:g} at most, got {repr(seconds)[:40]}")
        self.name = name
        self.fps = float(fps)
        check_size("size", size, 1)
        self.size = (int(size[0]), int(size[1]))
        self.length = max(1, round(seconds * fps))
        self.device = torch.device(device)
        keep_freed_memory()

    @abstractmethod
    def frames(self, start: int, stop: int) -> Tensor:
        """Frames number `start` to `stop - 1`, `[..., T, 3, H, W]` float32 in 0..1, in new memory."""

    def chunks(self, frames: int = 8, start: int = 0) -> Iterator[Tensor]:
        """Yield `[..., T, 3, H, W]` float32 in 0..1 with T <= `frames`, from frame `start` to the end.

        Raises:
            InputError: `frames` below 1 or `start` below 0.
        """
        check_chunks(frames, start)
        return (self.frames(n, min(n + frames, self.length)) for n in range(start, self.length, frames))


def check_chunks(frames: int, start: int) -> None:
    """Raise `InputError` unless `frames >= 1` and `start >= 0`."""
    if not (is_whole(frames) and frames >= 1):
        raise InputError(f"frames must be a whole number of at least 1 in a chunk, got {repr(frames)[:40]}")
    if not (is_whole(start) and start >= 0):
        raise InputError(f"start must be a frame number >= 0, got {repr(start)[:40]}")
