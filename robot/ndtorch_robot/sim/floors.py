"""What floors look like beyond carpet: tiles, checks, lines, floors without texture, and pools of light."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from ndtorch.errors import InputError

Floats = npt.NDArray[np.float32]

Pattern = Literal["carpet", "tiles", "checker", "smooth", "lines"]

PATTERNS: dict[str, tuple[float, float, float]] = {
    "carpet": (1.0, 0.0, 0.03),
    "tiles": (0.3, 0.006, 0.01),
    "checker": (0.25, 0.0, 0.01),
    "smooth": (1.0, 0.0, 0.0015),
    "lines": (2.5, 0.03, 0.03),
}
"""By default: metres from joint to joint, check to check and line to line; how wide joints and lines are, m; and the
standard deviation of the brightness of the material itself, where one level of 256 is 0.004."""

DARK = 0.35
"""Brightness of joints and lines, as a share of that of the floor."""

CHECKS = (0.65, 1.35)
"""Brightness of the two kinds of checks, as shares of that of the floor."""

TONES = 0.05
"""Standard deviation of the brightness of whole tiles."""


class Lamp(NamedTuple):
    """A pool of light on the floor.

    Attributes:
        x, y: its middle, m.
        radius: where it has fallen to 0.6 of its largest, m.
        gain: how much brighter its middle is, as a share; negative is a shadow.
    """

    x: float
    y: float
    radius: float
    gain: float


@dataclass(frozen=True)
class Floor:
    """What a floor looks like.

    Args:
        pattern: `"carpet"`, `"tiles"` with dark joints, `"checker"`, `"smooth"` (almost no texture), or `"lines"`:
            carpet with dark lines across x, such as sills and cables.
        size: metres from one to the next; 0 is that of `PATTERNS`.
        line: width of joints and lines, m; 0 is that of `PATTERNS`.
        lamps: pools of light.

    Raises:
        InputError: a pattern or numbers that cannot be.
    """

    pattern: Pattern = "carpet"
    size: float = 0.0
    line: float = 0.0
    lamps: tuple[Lamp, ...] = ()

    def __post_init__(self) -> None:
        if self.pattern not in get_args(Pattern):
            raise InputError(f"floor must be one of {', '.join(get_args(Pattern))}, got {self.pattern!r}")
        if not (0 <= self.size < math.inf and 0 <= self.line < math.inf) or 0 < self.step <= self.width:
            raise InputError(f"floor: sizes must be positive, and lines narrower than that, got {self}")
        for lamp in self.lamps:
            if not (all(map(math.isfinite, lamp)) and lamp.radius > 0 and -1 <= lamp.gain <= 3):
                raise InputError(f"floor: a lamp needs a radius > 0 and a gain from -1 to 3, got {lamp}")

    @property
    def step(self) -> float:
        return self.size or PATTERNS[self.pattern][0]

    @property
    def width(self) -> float:
        return self.line or PATTERNS[self.pattern][1]

    @property
    def spread(self) -> float:
        return PATTERNS[self.pattern][2]

    def light(self, x: Floats, y: Floats, texel: float, rng: np.random.Generator) -> Floats | None:
        """Brightness `[rows, columns]` as a factor at those middles, m, of texels of that width; None where it is 1
        everywhere.
        """
        light = self.material(x, y, texel, rng)
        for lamp in self.lamps:
            square = (x[None] - lamp.x) ** 2 + (y[:, None] - lamp.y) ** 2
            pool = 1 + lamp.gain * np.exp(-square / (2 * lamp.radius**2))
            light = np.asarray(pool if light is None else light * pool, np.float32)
        return light

    def material(self, x: Floats, y: Floats, texel: float, rng: np.random.Generator) -> Floats | None:
        if self.pattern in ("carpet", "smooth"):
            return None
        across = 1 - (1 - DARK) * covered(x, self.step, self.width, texel)
        if self.pattern == "lines":
            return np.asarray(np.broadcast_to(across, (len(y), len(x))), np.float32)
        column, row = np.floor(x / self.step).astype(np.int64), np.floor(y / self.step).astype(np.int64)
        if self.pattern == "checker":
            odd = (column[None] + row[:, None]) % 2
            return np.asarray(np.where(odd == 1, *CHECKS), np.float32)
        column, row = column - column.min(), row - row.min()
        tones = 1 + TONES * rng.standard_normal((row.max() + 1, column.max() + 1))
        along = 1 - (1 - DARK) * covered(y, self.step, self.width, texel)
        return np.asarray(tones[row][:, column] * np.minimum(across[None], along[:, None]), np.float32)


def covered(middles: Floats, step: float, width: float, texel: float) -> Floats:
    """Share of each texel that bands of this width about the multiples of `step` cover."""
    away = np.abs(middles - np.round(middles / step) * step)
    return np.asarray(np.clip((width / 2 + texel / 2 - away) / texel, 0.0, min(1.0, width / texel)), np.float32)
