"""Sixteen clips of 40 frames of 100x100 at once, and one after the other; results are kept until the next round."""

from __future__ import annotations

import sys
from typing import Any

import torch
from torch import Tensor, nn

import ndtorch
from ndtorch import vision
from tests.benchmarks.timing import Row, in_turn, machine, table

SIZE = (100, 100)
COLOR: dict[str, Any] = {
    "LowPass": lambda: vision.LowPass(0.5, 0.01),
    "HighPass": lambda: vision.HighPass(0.5, 0.01),
    "HassensteinReichardt": vision.HassensteinReichardt,
    "BarlowLevick": vision.BarlowLevick,
    "SmallTargetDetector": vision.SmallTargetDetector,
    "OrientedDoG": lambda: vision.OrientedDoG(SIZE),
    "VisualFeatures": lambda: vision.VisualFeatures(SIZE),
    "scale-free": lambda: ndtorch.load("scale-free", size=SIZE),
    "published": lambda: ndtorch.load("published", size=SIZE),
}
GREY = {name: getattr(vision, name) for name in ("NDMin", "NDMinus", "NDS", "ChahlSrinivasan")}


def row(name: str, module: nn.Module, clips: Tensor) -> Row:
    kept: dict[str, Any] = {}
    jobs: dict[str, Any] = {
        "apart": lambda: kept.update(apart=[module(clip) for clip in clips]),
        "at once": lambda: kept.update(once=module(clips)),
    }
    ms = {job: 1e3 * seconds for job, seconds in in_turn(jobs, rounds=7, repeat=1).items()}
    return Row(name, f"{ms['at once']:.0f} ms", f"{ms['apart']:.0f} ms", f"{ms['apart'] / ms['at once']:.2f}x")


if __name__ == "__main__":
    torch.set_num_threads(1)
    color = torch.rand(16, 40, 3, *SIZE, generator=torch.Generator().manual_seed(0))
    given = {**dict.fromkeys(COLOR, color), **dict.fromkeys(GREY, color[:, :, :1].contiguous())}
    with torch.inference_mode():
        rows = [row(name, (COLOR | GREY)[name](), given[name]) for name in sys.argv[1:] or given]
    print(machine(), table("Sixteen clips at once, against one after the other", rows), sep="\n\n")
