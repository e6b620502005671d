"""The moving bars of the binding papers, and bars equal in all but their fluctuation. [B §3.4; C §3]"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Unpack

import torch

from ndtorch.errors import InputError
from ndtorch.scenes.bars import SIZE, Bar, BarOptions, BarScene, split
from ndtorch.scenes.base import PerScene, for_each_scene, numbers
from ndtorch.scenes.fluctuation import Distance, Fluctuation, RandomShadow, SineShadow
from ndtorch.scenes.named import SECONDS

Color = tuple[float, float, float]
RED: Color = (0.75, 0.1, 0.1)
GREEN: Color = (0.1, 0.75, 0.1)
BLUE: Color = (0.1, 0.1, 0.75)

DEFAULT_PHASE = 290.0
"""Lead of the green bar over the red one, in degrees.

The papers do not give it. Two bars are told apart at every phase from 30 to 330 degrees; together with
`DEFAULT_BLUE_OFFSET` this one lies in the middle of a region where three bars are, too (31 of 90 combinations on a
grid of 20 degrees by 10 pixels), and its largest weight of two bars, 0.87, is close to the printed 0.85.
"""

DEFAULT_BLUE_OFFSET = 20.0
"""Columns by which the blue bar of three starts further right; see `DEFAULT_PHASE`."""

PERIOD = 50.0
"""Pixels a cycle of the sine shadow."""

EQUAL_PERIODS = (125 / 3, 50.0, 62.5)
"""Shadow periods of the three equal bars in pixels; each goes into 500 pixels a whole number of times."""

EQUAL_RATES = (0.8, 1.0, 1.25)
"""Cycles a second of the three equal bars that come and go."""


def one_bar(
    seconds: float = SECONDS,
    *,
    fluctuation: str | Fluctuation = "shadow",
    seed: int | Sequence[int] = 0,
    color: Color = RED,
    **options: Unpack[BarOptions],
) -> BarScene:
    """The red bar of `two_bars` alone. [B §3.4.2] Arguments, shapes and errors as there.

    >>> one_bar(seconds=2, fps=50).length
    100
    """
    (height, width), (look, shown) = options.get("size", SIZE), split(options)
    bar = Bar(color, -30.0, (0.1 * width, 0.08 * height), **look)
    return BarScene([bar], seconds, _fluctuation(fluctuation, 0.0, 1, seed), name="one-bar", **shown)


def two_bars(
    seconds: float = SECONDS,
    *,
    phase: PerScene = DEFAULT_PHASE,
    fluctuation: str | Fluctuation = "shadow",
    seed: int | Sequence[int] = 0,
    colors: tuple[Color, Color] = (RED, GREEN),
    shift: tuple[float, float] = (0.0, 0.0),
    **options: Unpack[BarOptions],
) -> BarScene:
    """The reference stimulus: red at -30° from the upper left, green at 210° from the upper right. [B §3.4.1]

    The bars cross every 5.8 s without touching, the green one 1.4 bar lengths below the red one.

    Args:
        seconds: duration.
        phase: lead in degrees of the green bar's brightness over the red bar's; both go through
            `speed cos 30° / 50 px` cycles a second (0.87 Hz). B values make a batch of B scenes. It sets the
            green bar's start in the shadow, within 25 columns of the upper right; with "distance" it is the
            lead in size. Without meaning for "random" and "none". The lead holds across the image's edges
            where the width is a multiple of 50 pixels.
        fluctuation: "shadow" (sine), "distance", "random" (shadow), "none", or one of one's own.
        seed: pattern of the random shadow; several make a batch.
        colors: of the two bars.
        shift: columns and rows by which all bars start elsewhere. `(250, -85)` brings the second crossing,
            at 10.4 s, to the middle of the image. The shadow stays, and so does the lead.
        options: see `BarOptions`.

    Returns:
        A source of frames `[T, 3, H, W]`, or `[B, T, 3, H, W]` for a batch.

    Raises:
        InputError: an unknown fluctuation, a phase that is neither a number nor a list of them, batches
            that do not fit each other, or what `Bar` and `BarScene` refuse.

    >>> scene = two_bars(seconds=0.2)
    >>> next(iter(scene.chunks(8))).shape
    torch.Size([8, 3, 500, 500])
    >>> two_bars(phase=[0, 90]).batch
    (2,)
    """
    bars = for_each_scene(lambda lead: _red_and_green(lead, colors, shift, options), phase=phase)
    return BarScene(bars, seconds, _fluctuation(fluctuation, phase, 2, seed), name="two-bars", **split(options)[1])


def three_bars(
    seconds: float = SECONDS,
    *,
    phase: PerScene = DEFAULT_PHASE,
    blue_offset: PerScene = DEFAULT_BLUE_OFFSET,
    fluctuation: str | Fluctuation = "shadow",
    seed: int | Sequence[int] = 0,
    colors: tuple[Color, Color, Color] = (RED, GREEN, BLUE),
    shift: tuple[float, float] = (0.0, 0.0),
    **options: Unpack[BarOptions],
) -> BarScene:
    """The reference stimulus and a blue bar that moves straight to the left. [B §3.4.2]

    Args:
        blue_offset: columns by which the blue bar starts further right, 0 to 50 for all its places in the
            shadow, through which it goes at `speed / 50 px` (1 Hz). B values make a batch of B scenes.

    Everything else as in `two_bars`. With "distance" green leads red, and blue leads green, by `phase`.
    The blue bar stays clear of the others for the first 20 seconds.

    >>> len(three_bars().bars)
    3
    """
    (height, width), (look, shown) = options.get("size", SIZE), split(options)

    def bars(lead: float, offset: float) -> list[Bar]:
        start = (0.65 * width + shift[0] + offset, 0.375 * height + shift[1])
        return [*_red_and_green(lead, colors[:2], shift, options), Bar(colors[2], 180.0, start, **look)]

    scenes = for_each_scene(bars, phase=phase, blue_offset=blue_offset)
    return BarScene(scenes, seconds, _fluctuation(fluctuation, phase, 3, seed), name="three-bars", **shown)


def equal_bars(
    seconds: float = SECONDS,
    *,
    fluctuation: str | Fluctuation = "shadow",
    seed: int | Sequence[int] = 0,
    color: Color = GREEN,
    direction: float = -30.0,
    **options: Unpack[BarOptions],
) -> BarScene:
    """Three bars alike in color, direction and orientation that fluctuate differently. [C §5.5.2]

    With "shadow" every bar goes through a sine shadow of its own (`EQUAL_PERIODS`), with "distance" each
    comes and goes at its own rate (`EQUAL_RATES`), with "random" they are in different places of one pattern.
    The bars keep their distances and never touch. Arguments, shapes and errors as in `two_bars`.
    """
    (height, width), (look, shown) = options.get("size", SIZE), split(options)
    if fluctuation == "shadow":
        fluctuation = SineShadow(EQUAL_PERIODS)
    elif fluctuation == "distance":
        fluctuation = Distance(EQUAL_RATES)
    bars = [Bar(color, direction, (share * width, share * height), **look) for share in (0.2, 0.5, 0.8)]
    return BarScene(bars, seconds, _fluctuation(fluctuation, 0.0, 3, seed), name="equal-bars", **shown)


def _red_and_green(lead: float, colors: Sequence[Color], shift: tuple[float, float], options: BarOptions) -> list[Bar]:
    (height, width), (look, _) = options.get("size", SIZE), split(options)
    red_x, red_y = 0.1 * width + shift[0], 0.08 * height + shift[1]
    # Light is sin(2 pi x / PERIOD). Red moves right and starts at the phase 2 pi red_x / PERIOD, green moves
    # left and starts at pi - 2 pi green_x / PERIOD: the lead fixes the sum of the two places.
    nearest = 0.85 * width + shift[0]
    green_x = nearest + (PERIOD / 2 - PERIOD * lead / 360 - red_x - nearest) % PERIOD
    green_y = red_y + 1.4 * options.get("length", Bar.length)
    return [Bar(colors[0], -30.0, (red_x, red_y), **look), Bar(colors[1], 210.0, (green_x, green_y), **look)]


def _fluctuation(kind: str | Fluctuation, phase: PerScene, bars: int, seed: int | Sequence[int]) -> Fluctuation:
    if isinstance(kind, Fluctuation):
        return kind
    if kind == "shadow":
        return SineShadow(PERIOD)
    if kind == "random":
        return RandomShadow(seed)
    if kind == "none":
        return Fluctuation()
    if kind == "distance":
        return Distance(phase=numbers("phase", phase, 1)[..., None] * torch.arange(bars, dtype=torch.float64))
    raise InputError(f"fluctuation must be 'shadow', 'distance', 'random' or 'none', got {kind!r}")
