"""How each of the ten features is drawn, in every figure and recording.

Colors come from the color-blind safe palettes of Okabe & Ito and of Paul Tol. The color features are solid
lines in their own color, motion is dashed and orientation dotted, each with a pattern of its own.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

from ndtorch.vision.features import FEATURES

Dashes = Literal["solid"] | tuple[float, tuple[float, ...]]


class Style(NamedTuple):
    """One feature's line: color as "#rrggbb", and matplotlib's (offset, on-off lengths in line widths)."""

    color: str
    dashes: Dashes


STYLES: dict[str, Style] = {
    "left": Style("#e69f00", (0, (6, 2))),
    "right": Style("#cc79a7", (0, (3, 1.5))),
    "down": Style("#56b4e9", (0, (6, 2, 1, 2))),
    "up": Style("#666666", (0, (6, 2, 1, 2, 1, 2))),
    "0°": Style("#a5673f", (0, (1, 1))),
    "60°": Style("#999933", (0, (1, 1.8))),
    "120°": Style("#7a68d8", (0, (1, 3))),
    "red": Style("#cc3311", "solid"),
    "green": Style("#009e73", "solid"),
    "blue": Style("#0072b2", "solid"),
}
"""Style of every feature, in the order of `FEATURES`."""

GREY = "#888888"
"""What has no color of its own."""
GREY_RGB = (136, 136, 136)


def rgb(feature: str | int) -> tuple[int, int, int]:
    """Color of a feature, by name or number, as three values in 0..255."""
    name = FEATURES[feature] if isinstance(feature, int) else feature
    red, green, blue = bytes.fromhex(STYLES[name].color[1:])
    return red, green, blue
