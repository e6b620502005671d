"""Moving bars on a black background, drawn at sub-pixel positions. [B §3.4]"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypedDict, cast

import numpy as np
import torch
from torch import Tensor

from ndtorch.arguments import check_number, is_finite
from ndtorch.errors import InputError
from ndtorch.scenes.base import RenderedScene
from ndtorch.scenes.fluctuation import Fluctuation


@dataclass(frozen=True)
class Bar:
    """One bar.

    Attributes:
        color: red, green and blue in 0..1.
        direction: of motion, in degrees counter-clockwise as seen: 0 right, 90 up.
        start: column and row of the center in the first frame; rows point down, whole numbers are pixel
            centers.
        orientation: degrees counter-clockwise as seen, 0 = long axis vertical. None: equal to the direction,
            which is to say that the bar moves across its long axis.
        speed: pixels a second.
        length, width: pixels.

    Raises:
        InputError: a color outside 0..1, a size that is not positive, or a number that is not finite.
    """

    color: tuple[float, float, float]
    direction: float
    start: tuple[float, float]
    orientation: float | None = None
    speed: float = 50.0
    length: float = 50.0
    width: float = 12.0

    def __post_init__(self) -> None:
        color, start = self.color, self.start
        if not (
            isinstance(color, tuple | list) and len(color) == 3 and all(is_finite(x) and 0 <= x <= 1 for x in color)
        ):
            raise InputError(f"color must be red, green and blue in 0..1, got {repr(color)[:40]}")
        if not (isinstance(start, tuple | list) and len(start) == 2 and all(map(is_finite, start))):
            raise InputError(f"start must be a column and a row, got {repr(start)[:40]}")
        for name in ("direction", "speed", "length", "width"):
            check_number(name, getattr(self, name))
        check_number("orientation", self.tilt)
        if not (self.length > 0 and self.width > 0):
            raise InputError(f"length and width must be positive pixels, got {self.length} and {self.width}")

    @property
    def tilt(self) -> float:
        """Orientation in degrees, also where it was left to follow the direction."""
        return self.direction if self.orientation is None else self.orientation


SIZE = (500, 500)
"""Height and width of the scenes of the papers, pixels."""


class BarOptions(TypedDict, total=False):
    """What all scenes of bars take: speed (50 pixels a second), length and width of a bar (50 and 12 pixels), size
    (height and width of the image, pixels; (500, 500), single bars (100, 100)), fps (100) and device (where frames are
    rendered)."""

    speed: float
    length: float
    width: float
    size: tuple[int, int]
    fps: float
    device: torch.device | str


def split(options: BarOptions) -> tuple[dict[str, Any], dict[str, Any]]:
    """Options of each bar, and those of the scene."""
    look = {key: value for key, value in options.items() if key in ("speed", "length", "width")}
    return look, {key: value for key, value in options.items() if key not in look}


class BarScene(RenderedScene):
    """Any number of moving bars on black, wrapping around the edges; later bars cover earlier ones.

    A bar covers a pixel by the product of two ramps, `clamp(half + 1/2 - |u|, 0, 1)` along and across it, so
    its area stays the same at every sub-pixel position (whole-pixel positions would break learning). Every
    pixel of a bar takes the light of its own place.

    Args:
        bars: the bars of one scene, or of B scenes (the same number of bars each).
        seconds, size, fps, device: see `RenderedScene`.
        fluctuation: shadow or distance; its values may be one for all, one a bar, or one a scene and bar.

    Shapes:
        frames `[T, 3, H, W]`; `[B, T, 3, H, W]` where bars or fluctuation are given for B scenes.

    Raises:
        InputError: no bars, scenes with different numbers of bars, batches that do not fit each other, or a
            bar that does not fit into the image.

    >>> from ndtorch.scenes import Bar
    >>> scene = BarScene([Bar((1.0, 0.0, 0.0), 0.0, (20.0, 50.0))], seconds=0.5, size=(100, 100))
    >>> scene.frames(0, 2).shape
    torch.Size([2, 3, 100, 100])
    """

    def __init__(
        self,
        bars: Sequence[Bar] | Sequence[Sequence[Bar]],
        seconds: float,
        fluctuation: Fluctuation | None = None,
        size: tuple[int, int] = SIZE,
        fps: float = 100.0,
        name: str = "bars",
        device: torch.device | str = "cpu",
    ) -> None:
        super().__init__(name, seconds, fps, size, device)
        if len(bars) == 0:
            raise InputError("bars must hold at least one bar, got none")
        single = isinstance(bars[0], Bar)
        scenes = [list(scene) for scene in cast(Sequence[Sequence[Bar]], [bars] if single else bars)]
        if len({len(scene) for scene in scenes}) != 1 or not scenes[0]:
            raise InputError(f"every scene must hold the same number of bars, got {[len(s) for s in scenes]}")
        batch = () if single else (len(scenes),)
        self.bars = scenes[0] if single else scenes
        self.fluctuation = fluctuation or Fluctuation()
        light = self.fluctuation.light(self.size)
        scale = self.fluctuation.scale(torch.zeros(1, dtype=torch.float64))
        n_bars = len(scenes[0])
        misfit = InputError(
            f"fluctuation must fit {n_bars} bars in scenes {list(batch)}, "
            f"got {list(light.shape[:-2])} for light and {list(scale.shape[:-1])} for size"
        )
        if not {light.shape[-3], scale.shape[-2]} <= {1, n_bars}:
            raise misfit
        try:
            self.batch = np.broadcast_shapes(batch, tuple(light.shape[:-3]), tuple(scale.shape[:-2]))
        except ValueError as error:
            raise misfit from error

        def values(pick: Iterable[float]) -> Tensor:
            tensor = torch.tensor(list(pick), dtype=torch.float64).view(*batch, n_bars)
            return tensor.expand(*self.batch, n_bars).to(self.device)

        flat = [bar for scene in scenes for bar in scene]
        self._x, self._y = values(b.start[0] for b in flat), values(b.start[1] for b in flat)
        self._vx = values(b.speed * math.cos(math.radians(b.direction)) for b in flat)
        self._vy = values(-b.speed * math.sin(math.radians(b.direction)) for b in flat)
        self._cos = values(math.cos(math.radians(b.tilt)) for b in flat)
        self._sin = values(math.sin(math.radians(b.tilt)) for b in flat)
        self._length, self._width = values(b.length for b in flat), values(b.width for b in flat)
        colors = torch.tensor([b.color for b in flat], dtype=torch.float32).view(*batch, n_bars, 3)
        self._color = colors.expand(*self.batch, n_bars, 3).to(self.device)
        self._light = light.expand(*self.batch, n_bars, *light.shape[-2:]).contiguous().to(self.device)
        # How far from its center, in columns and in rows, each bar may touch a pixel center.
        across, along = self._width / 2 + 0.5, self._length / 2 + 0.5
        cos, sin = self._cos.abs(), self._sin.abs()
        reach = torch.stack([across * cos + along * sin, across * sin + along * cos], -1)
        self._reach = reach.reshape(-1, n_bars, 2).amax(0).tolist()
        for reach_x, reach_y in self._reach:
            if math.floor(2 * reach_x) + 1 > self.size[1] or math.floor(2 * reach_y) + 1 > self.size[0]:
                one = f"{2 * reach_y:.0f} rows and {2 * reach_x:.0f} columns, size is {size[0]} x {size[1]}"
                raise InputError(f"bars must fit into the image: one takes {one}")

    def frames(self, start: int, stop: int) -> Tensor:
        """Frames number `start` to `stop - 1`, `[*batch, T, 3, H, W]` float32 in 0..1."""
        height, width = self.size
        # Times come from whole frame numbers in double precision: nothing drifts and chunks do not matter.
        seconds = torch.arange(start, stop, device=self.device).double() / self.fps
        canvas = torch.zeros(*self.batch, len(seconds), 3, height * width, device=self.device)
        self.paint(canvas, seconds)
        return canvas.view(*canvas.shape[:-1], height, width)

    def paint(self, canvas: Tensor, seconds: Tensor, light: Sequence[Tensor] | None = None) -> None:
        """Paint the bars of those moments `[T]` into `canvas` `[*batch, T, 3, H W]`.

        Args:
            canvas: what the bars are painted over.
            seconds: for which the bars have moved, float64.
            light: brightness of each bar at those moments, `[T]`; None for that of the fluctuation.
        """
        (height, width), scales = self.size, self.fluctuation.scale(seconds)
        scales = scales.expand(*self.batch, len(self._reach), len(seconds))
        for k, (reach_x, reach_y) in enumerate(self._reach):  # only the patch around each bar is touched
            scale = scales[..., k, :]
            columns, u_x, v_x = self._axis(self._x, self._vx, k, seconds, reach_x, self._cos, -self._sin)
            rows, u_y, v_y = self._axis(self._y, self._vy, k, seconds, reach_y, -self._sin, -self._cos)
            columns, rows = columns.remainder_(width), rows.remainder_(height)

            cover = _ramp(u_x[..., None, :] + u_y[..., :, None], self._width[..., k, None] * scale)
            cover *= _ramp(v_x[..., None, :] + v_y[..., :, None], self._length[..., k, None] * scale)
            where = rows[..., :, None] * width + columns[..., None, :]
            if light is None:
                shadow = self._light[..., k, :, :]
                # Light that is the same in all rows is looked up by column alone.
                in_light = where if shadow.shape[-2] > 1 else columns[..., None, :]
                places = in_light.flatten(len(self.batch))
                brightness = shadow.flatten(-2).gather(-1, places).view(in_light.shape)
            else:
                brightness = light[k][:, None, None]
            lit = self._color[..., k, :][..., None, :, None, None] * brightness[..., None, :, :]

            pixels = where.flatten(-2)[..., None, :].expand(*where.shape[:-2], 3, -1)
            behind = canvas.gather(-1, pixels).view(*canvas.shape[:-1], *where.shape[-2:])
            painted = behind + cover[..., None, :, :] * (lit - behind)
            canvas.scatter_(-1, pixels, painted.flatten(-2))

    def _axis(
        self, at: Tensor, velocity: Tensor, k: int, seconds: Tensor, reach: float, u: Tensor, v: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Pixels within reach of bar k along one image axis, and what each adds to the bar's coordinates.

        Returns the pixel numbers (not yet wrapped) and the parts of u (across the bar) and v (along it), all
        `[*batch, T, P]`.
        """
        center = at[..., k, None] + velocity[..., k, None] * seconds
        first = torch.ceil(center - reach)
        steps = torch.arange(math.floor(2 * reach) + 1, device=self.device)
        pixels = first.long()[..., None] + steps
        offset = (first - center)[..., None] + steps
        return (
            pixels,
            (offset * u[..., k, None, None]).float(),
            (offset * v[..., k, None, None]).float(),
        )


def _ramp(distance: Tensor, extent: Tensor) -> Tensor:
    """Share of a pixel covered by a strip `extent` pixels wide whose middle is `distance` away.

    `clamp(extent/2 + 1/2 - |distance|, 0, 1)`, and at most `extent` where the strip is narrower than a pixel.
    `distance` `[*batch, T, P, P]` is overwritten; `extent` `[*batch, T]`.
    """
    edge = (extent / 2 + 0.5).float()[..., None, None]
    top = extent.clamp(max=1.0).float()[..., None, None]
    return torch.minimum(distance.abs_().neg_().add_(edge).clamp_(min=0.0), top)
