"""The papers' two and three bars at every phase of their shadow, as superposed sums. [B §3.4.1-3.4.2]

`ndtorch.score.bars` measures the single bars again and writes `cycles.csv`.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from ndtorch.binding.feedback import settled as passage
from ndtorch.scenes import Bar, BarScene, SineShadow, three_bars
from ndtorch.scenes.bar_scenes import BLUE, GREEN, PERIOD, RED
from ndtorch.vision import FEATURES, VisualFeatures
from ndtorch_train.score.scenes import FPS
from ndtorch_train.score.single_bars import SPEED
from ndtorch_train.score.truth import by_group, present

PHASES = tuple(range(0, 360, 20))
BLUE_OFFSETS = (0.0, 10.0, 20.0, 30.0, 40.0)
HARMONICS = 4
BARS = {"red": (RED, -30.0), "green": (GREEN, 210.0), "blue": (BLUE, 180.0)}
TABLE = Path(__file__).with_name("cycles.csv")
CANVAS = 350
RENDERED = 4.0
"""Seconds of every single bar that are rendered; the first half lets the motion filters settle."""


def single_bar_cycles() -> dict[str, Tensor]:
    """The measured coefficients of all three bars, see `measure_cycle`."""
    cycles = {name: torch.zeros(2 * HARMONICS + 1, 10, dtype=torch.float64) for name in BARS}
    with TABLE.open(encoding="utf-8") as file:
        for name, term, *sums in list(csv.reader(file))[1:]:
            cycles[name][int(term)] = torch.tensor([float(value) for value in sums], dtype=torch.float64)
    return cycles


def measure_cycle(name: str) -> Tensor:
    """Fourier coefficients of the ten sums of one bar of `three_bars` alone, `[2 * HARMONICS + 1, 10]`.

    The sums depend on time only through the bar's phase in the shadow, `sin(phase)` being its light. The coefficients
    of `fourier_basis(phase)` come from rendered frames by least squares.
    """
    color, direction = BARS[name]
    # A width of a whole number of shadow periods, so that the shadow closes at the edges.
    start = (CANVAS / 2, CANVAS / 2)
    scene = BarScene([Bar(color, direction, start)], RENDERED, SineShadow(PERIOD), (CANVAS, CANVAS), FPS)
    features, state, parts = VisualFeatures((CANVAS, CANVAS)), None, []
    with torch.inference_mode():
        for frames in scene.chunks(8):
            sums, state = features(frames, state)
            parts.append(sums)
    sums = torch.cat(parts).double()
    times = torch.arange(len(sums), dtype=torch.float64) / FPS
    phase = 2 * math.pi * (start[0] + SPEED * math.cos(math.radians(direction)) * times) / PERIOD
    settled = len(sums) // 2
    coefficients: Tensor = torch.linalg.lstsq(fourier_basis(phase[settled:]), sums[settled:]).solution
    return coefficients


def fourier_basis(phase: Tensor) -> Tensor:
    """1, sin and cos of the phase and its multiples, `[..., 2 * HARMONICS + 1]`."""
    multiples = phase.unsqueeze(-1) * torch.arange(1, HARMONICS + 1, dtype=phase.dtype)
    return torch.cat([torch.ones_like(phase).unsqueeze(-1), multiples.sin(), multiples.cos()], -1)


@dataclass(frozen=True)
class BarSet:
    """The papers' bars at many phases.

    Attributes:
        name: for tables.
        sums: `[B, T, 10]` at 100 samples a second.
        truth: features of the bars, `[bars, 10]` bool, the same in all B scenes.
        settings: phase in degrees and offset in pixels of every scene.
    """

    name: str
    sums: Tensor
    truth: Tensor
    settings: list[tuple[float, float]]


def bar_sets(seconds: float, first_stage: Tensor) -> list[BarSet]:
    """Two bars at 18 phases, and three bars at 90 combinations of phase and offset of the blue one."""
    cycles = single_bar_cycles()
    own = torch.stack([c[1:].square().sum(0).sqrt() for c in cycles.values()])
    truth = present(by_group(own.float()) @ passage(first_stage).T)
    two = [(float(phase), 0.0) for phase in PHASES]
    three = [(float(phase), offset) for phase in PHASES for offset in BLUE_OFFSETS]
    return [
        BarSet("two bars", together(cycles, two, seconds, blue=False), truth[:2], two),
        BarSet("three bars", together(cycles, three, seconds, blue=True), truth, three),
    ]


def together(cycles: dict[str, Tensor], settings: list[tuple[float, float]], seconds: float, blue: bool) -> Tensor:
    """The sums of the bars at those phases, superposed, `[B, T, 10]`."""
    times = torch.arange(round(seconds * FPS), dtype=torch.float64) / FPS
    total = []
    for lead, offset in settings:
        # The same starts as `three_bars` in a 500 x 500 image.
        places = three_bars(1.0, phase=lead, blue_offset=offset).bars
        sums = torch.zeros(len(times), 10, dtype=torch.float64)
        for name, bar in zip(BARS, places if blue else places[:2], strict=False):
            assert isinstance(bar, Bar)
            column = bar.start[0] + bar.speed * math.cos(math.radians(bar.direction)) * times
            sums += fourier_basis(2 * math.pi * column / PERIOD) @ cycles[name]
        total.append(sums.float())
    return torch.stack(total)


def main() -> None:
    """Measure the three bars and write the table."""
    torch.set_num_threads(1)
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["bar", "term", *FEATURES])
        for name in BARS:
            for term, sums in enumerate(measure_cycle(name).tolist()):
                writer.writerow([name, term, *(f"{value:.5g}" for value in sums)])


if __name__ == "__main__":
    main()
