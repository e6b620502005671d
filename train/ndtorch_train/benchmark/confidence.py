"""Fit the confidence of `scale-free` on the split tune: `python -m ndtorch_train.benchmark.confidence FOLDER SCENES`.

All sets of `ndtorch benchmark over-time`, and the papers' bars in step. Prints the coefficients of
`ndtorch.binding.readout.memory`. Sums are kept in the folder.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from pathlib import Path

import torch
from torch import Tensor

import ndtorch
from ndtorch.binding import ScaleFreeModel
from ndtorch.binding.readout.memory import count_evidence, each_evidence
from ndtorch.scenes import three_bars, two_bars
from ndtorch_train.benchmark.over_time import SETS, Rendered, kept_sums, paper_truth, scenes_of
from ndtorch_train.benchmark.scene_scores import GOOD_F1, feature_f1

SECONDS, FPS, FIRST = 64, 25, 6
PHASES = (0.0, 4.0, 176.0, 180.0, 184.0, 356.0)


def in_step(phase: float, bars: int) -> Rendered:
    """The papers' bars at a phase, from other places than those of the split test."""
    build = two_bars if bars == 2 else three_bars
    return Rendered(build(SECONDS, phase=phase, shift=(30.0, -20.0), fps=FPS), paper_truth()[:bars])


def logistic(known: Tensor, right: Tensor) -> list[float]:
    """Coefficients of largest likelihood, by Newton's method."""
    found, ridge = known.new_zeros(known.shape[-1]), 1e-3 * torch.eye(known.shape[-1], dtype=known.dtype)
    for _ in range(50):
        sure = torch.sigmoid(known @ found)
        curvature = (known * (sure * (1 - sure)).unsqueeze(-1)).mT @ known + ridge
        found = found + torch.linalg.solve(curvature, known.mT @ (right - sure) - ridge @ found)
    return [round(float(value), 3) for value in found]


def fit(scenes: dict[str, Callable[[], Rendered]], folder: Path) -> tuple[list[float], list[float]]:
    """Coefficients of the number and of objects; sums of the scenes by the names of their files."""
    model = ndtorch.load("scale-free", fps=FPS)
    assert isinstance(model, ScaleFreeModel)
    sums = torch.stack([kept_sums(scene, SECONDS, folder / f"{name}.npy") for name, scene in scenes.items()])
    truth, state = [scene().truth for scene in scenes.values()], None
    known: list[Tensor] = []
    right: list[Tensor] = []
    objects: list[Tensor] = []
    good: list[float] = []
    with torch.inference_mode():
        for n in range(SECONDS):
            _, state = model.from_sums(sums[:, n * FPS : (n + 1) * FPS], state)
            if n + 1 < FIRST:
                continue
            memory = model.second.known(state.second)
            known.append(count_evidence(memory).double())
            right.append((memory.owners.sum(-1) == torch.tensor([len(bars) for bars in truth])).double())
            evidence = each_evidence(memory).double()
            for scene, neuron in memory.owners.nonzero().tolist():
                objects.append(evidence[scene, neuron])
                found = memory.rows[scene, neuron].unsqueeze(0) > 0
                good.append(float(feature_f1(found, truth[scene]).max() >= GOOD_F1))
    return logistic(torch.cat(known), torch.cat(right)), logistic(torch.stack(objects), torch.tensor(good).double())


if __name__ == "__main__":
    count = int(sys.argv[2])
    drawn = {f"{name}-{n}": one for name in SETS for n, one in enumerate(scenes_of(name, "tune", count, FPS))}
    drawn |= {f"{bars} at {p:g}": functools.partial(in_step, p, bars) for p in PHASES for bars in (2, 3)}
    print("OF_COUNT, OF_OBJECT =", *fit(drawn, Path(sys.argv[1])))
