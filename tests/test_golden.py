"""Four runs beside the numbers of the papers and of an independent implementation."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

import ndtorch
from ndtorch.scenes import two_bars
from ndtorch.vision import VisualFeatures
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.drive import drive

pytestmark = pytest.mark.slow

WEIGHTS = """
.0000 .0000 .0435 .0006 .0118 .0035 .0000 .0000 .5827 .0007
.0000 .0000 .0496 .0000 .0288 .0023 .0043 .6976 .0263 .0000
.0901 .0996 .0000 .0000 .0308 .0042 .0032 .3325 .4533 .0000
.0012 .0000 .0000 .0000 .0000 .0000 .0000 .0000 .0002 .0485
.0404 .1029 .0567 .0000 .0000 .0035 .0031 .3682 .3017 .0000
.0636 .0372 .0376 .0002 .0169 .0000 .0011 .0835 .2354 .0001
.0002 .0810 .0269 .0000 .0158 .0012 .0000 .2959 .0637 .0000
.0000 .1695 .0440 .0012 .0281 .0016 .0045 .0000 .0001 .0000
.1998 .0094 .0687 .0000 .0268 .0046 .0012 .0067 .0000 .0000
.0018 .0000 .0000 .0919 .0000 .0000 .0000 .0000 .0010 .0000
"""
"""Of `published` after 10 s of two bars; an independent implementation agrees to .0006."""

SUMS = (
    (0.0000007, 0.0000008, 0.0000008, 0.0000008, 58.7212067, 0.0017330, 1.6024485, 1536.0, 1536.0, 1536.0),
    (0.4608884, 15.7452354, 8.6895065, 0.2814794, 58.7220917, 0.0017331, 1.6024567, 1536.0, 1536.0, 1536.0),
    (0.0550981, 8.0391998, 0.9788631, 4.4579268, 58.7197266, 0.0017328, 1.6024568, 1536.0, 1536.0, 1536.0),
)
"""The ten features of frames 1 to 3 of `drifting`."""


def drifting() -> torch.Tensor:
    """Four frames `[4, 3, 48, 64]` in which a sine moves up and right, at another speed in each color."""
    t, y, x = np.meshgrid(np.arange(4), np.arange(48), np.arange(64), indexing="ij")
    phases = [3 * x / 64 - (color + 1) * t / 7 + color * y / 48 for color in range(3)]
    return torch.from_numpy(np.stack([0.5 + 0.5 * np.sin(2 * np.pi * phase) for phase in phases], 1)).float()


def test_weights_of_published() -> None:
    """[B fig. 8] Two bars in a striped shadow."""
    model, state = ndtorch.load("published"), None
    with torch.inference_mode():
        for frames in two_bars(seconds=10.0).chunks(10):
            _, state = model(frames, state)
    wanted = torch.tensor([float(number) for number in WEIGHTS.split()]).reshape(10, 10)
    torch.testing.assert_close(model.weights(state), wanted, rtol=0, atol=1e-3)


def test_ten_features() -> None:
    """[B §2.1] To a hundred thousandth of the largest of each group; the first frame settles the filters."""
    with torch.no_grad():
        sums, _ = VisualFeatures(size=(48, 64), dt=0.01)(drifting(), None)
    wanted = torch.tensor(SUMS)
    for group in (slice(0, 4), slice(4, 7), slice(7, 10)):
        torch.testing.assert_close(
            sums[1:, group], wanted[:, group], rtol=1e-5, atol=1e-5 * float(wanted[:, group].max())
        )


def test_map_of_a_minute() -> None:
    """[A fig. 12] Nine tenths of the map's mass lie within 10 cm of an edge (.91)."""
    result = drive(DriveConfig(controller="ranging", arena="loop", stereo="features", seed=0, seconds=60.0))
    assert not result.simulation.collisions
    assert result.summary["map"]["precision"] >= 0.88
    assert result.summary["map"]["surfaces"] >= 0.93


def test_run_with_the_simulated_link(tmp_path: Path) -> None:
    """The real loop, the protocol and the firmware's code drive a simulated car for eight seconds without a hit."""
    file = Path(__file__).parents[1] / "robot/configs/sim.toml"
    command = [sys.executable, "-m", "ndtorch", "run", str(file), "--go", "--seconds", "8", "--json"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=180, check=False)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["collisions"] == 0
    assert report["distance_m"] > 1.0
