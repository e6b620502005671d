"""Single bars and colors for tuning curves. [B §3.1-3.3]"""

from __future__ import annotations

from typing import Unpack

import torch
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.scenes.bar_scenes import Color
from ndtorch.scenes.bars import Bar, BarOptions, BarScene, split
from ndtorch.scenes.base import PerScene, for_each_scene
from ndtorch.scenes.fluctuation import Fluctuation

WHITE: Color = (1.0, 1.0, 1.0)


def moving_bar(
    direction: PerScene,
    orientation: PerScene | None = None,
    *,
    color: Color = WHITE,
    seconds: float = 4.0,
    fluctuation: Fluctuation | None = None,
    start: tuple[float, float] | None = None,
    **options: Unpack[BarOptions],
) -> BarScene:
    """One bar in steady light that starts in the middle of the image, or at `start` (column, row).

    Args:
        direction: of motion in degrees counter-clockwise as seen, 0 = right; B values make B scenes.
        orientation: in degrees counter-clockwise, 0 = long axis vertical; B values, or None for a bar that
            moves across its long axis.
        options: see `BarOptions`.

    Returns:
        A source of frames `[T, 3, H, W]`, or `[B, T, 3, H, W]` for B angles.

    Raises:
        InputError: angles that are not finite or do not fit each other, or what `Bar` and `BarScene` refuse.

    >>> moving_bar([0.0, 90.0, 180.0]).frames(0, 4).shape
    torch.Size([3, 4, 3, 100, 100])
    """
    options = {"size": (100, 100), **options}
    at = ((options["size"][1] - 1) / 2, (options["size"][0] - 1) / 2) if start is None else start
    look, shown = split(options)
    tilts = direction if orientation is None else orientation
    bars = for_each_scene(lambda a, b: [Bar(color, a, at, b, **look)], direction=direction, orientation=tilts)
    return BarScene(bars, seconds, fluctuation, name="moving-bar", **shown)


def static_bar(
    orientation: PerScene,
    color: Color = WHITE,
    *,
    center: tuple[float, float] | None = None,
    **options: Unpack[BarOptions],
) -> Tensor:
    """One frame of a bar at rest, `[3, H, W]`, or `[B, 3, H, W]` for B orientations.

    Args:
        orientation: degrees counter-clockwise as seen, 0 = long axis vertical.
        color: red, green and blue in 0..1.
        center: column and row of the bar's center; None is the middle of the image.
        options: see `BarOptions`.

    Raises:
        InputError: as `moving_bar`.

    >>> static_bar(torch.tensor([0.0, 90.0])).shape
    torch.Size([2, 3, 100, 100])
    """
    scene = moving_bar(0.0, orientation, color=color, seconds=1.0, start=center, **options)
    return scene.frames(0, 1).select(-4, 0)


def hsl_color(hue: float | Tensor, saturation: float | Tensor, lightness: float | Tensor) -> Tensor:
    """Red, green and blue in 0..1 of a color given by hue, saturation and lightness: `[..., 3]`.

    Args:
        hue: degrees, 0 red, 120 green, 240 blue; any turn.
        saturation, lightness: 0..1.

    The three broadcast against each other.

    Raises:
        InputError: saturation or lightness outside 0..1.

    >>> hsl_color(120, 1.0, 0.5)
    tensor([0., 1., 0.])
    """
    h, s, x = (torch.as_tensor(value, dtype=torch.get_default_dtype()) for value in (hue, saturation, lightness))
    for name, value in (("saturation", s), ("lightness", x)):
        if not bool(((value >= 0) & (value <= 1)).all()):
            raise InputError(f"{name} must lie in 0..1, got {value.min().item():g} to {value.max().item():g}")
    # Every channel is the same trapezoid over the hue, a third of a turn apart.
    turn = (h[..., None] / 30 + torch.tensor([0.0, 8.0, 4.0], dtype=h.dtype, device=h.device)) % 12
    wave = torch.minimum(turn - 3, 9 - turn).clamp(-1, 1)
    chroma = (s * torch.minimum(x, 1 - x))[..., None]
    color: Tensor = x[..., None] - chroma * wave
    return color.clamp(0, 1)
