"""Figures of a run: they are drawn for every kind of result, quickly, and show what they should."""

from __future__ import annotations

import dataclasses
import sys
import warnings
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import torch

import ndtorch
from ndtorch.binding import bound_objects, object_table
from ndtorch.report import plots
from ndtorch.report.plots import attention, layout, signals, weights
from ndtorch.report.plots.signals import POINTS, thinned
from ndtorch.run.result import Moment, RunResult, Trace

NAMES = ["outputs.png", "weights.png", "weights_over_time.png", "frames.png"]


def bars() -> torch.Tensor:
    """Weights with two owners, red and green."""
    weights = torch.zeros(10, 10)
    weights[[1, 2, 4, 6], 7] = torch.tensor([0.8, 0.6, 0.4, 0.3])
    weights[[0, 2, 5], 8] = torch.tensor([0.8, 0.5, 0.4])
    return weights


def moment(neuron: int, height: int = 24, width: int = 32) -> Moment:
    pixels = np.random.default_rng(neuron).integers(0, 256, (height, width, 3), dtype=np.uint8)
    return Moment(6.0 + neuron, neuron, 0.2, pixels, pixels // 3)


@pytest.fixture
def result() -> RunResult:
    weights = bars()
    table = object_table(weights)
    outputs, trace = Trace((10,)), Trace((10, 10))
    for step in range(300):
        outputs.add(step * 0.05, torch.sin(step * 0.05 + torch.arange(10.0)))
        trace.add(step * 0.05, weights * step / 300)
    return RunResult(
        "two-bars",
        "published",
        (500, 500),
        bound_objects(table),
        "stable",
        table,
        None,
        settle=4.0,
        simulated_seconds=15.0,
        wall_seconds=1.0,
        frames=1500,
        outputs=outputs,
        weights=trace,
        final_weights=weights.numpy(),
        moments={7: moment(7), 8: moment(8)},
    )


def with_weights(result: RunResult, weights: torch.Tensor) -> RunResult:
    table = object_table(weights)
    return dataclasses.replace(result, final_weights=weights.numpy(), table=table, objects=bound_objects(table))


def words(figure: object) -> list[str]:
    """Every text in a figure."""
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    assert isinstance(figure, Figure)
    return [text.get_text() for text in figure.findobj(Text)]  # type: ignore[attr-defined]


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> dict[str, list[str]]:
    """The words of every figure that is saved, by file name."""
    seen: dict[str, list[str]] = {}

    def saved(figure: object, path: Path) -> Path:
        seen[Path(path).name] = words(figure)
        return layout.save(figure, path)  # type: ignore[arg-type]

    for module in (attention, signals, weights):
        monkeypatch.setattr(module, "save", saved)
    return seen


def test_draws_four_pictures_and_says_what_they_show(
    result: RunResult, drawn: dict[str, list[str]], tmp_path: Path
) -> None:
    before = "matplotlib.pyplot" in sys.modules
    paths = plots.draw_all(result, tmp_path / "new" / "folder")
    assert ("matplotlib.pyplot" in sys.modules) == before  # its state is the user's
    assert [path.name for path in paths] == NAMES
    for path in paths:
        picture = matplotlib.image.imread(path)
        assert picture.shape[0] > 200
        assert picture[..., :3].std() > 0.01
        assert "2 objects (red, green) · weights stable · 15.0 s seen" in drawn[path.name]
    assert {"Each column: weights FROM this neuron", "Each row: weights TO this neuron"} < set(drawn["weights.png"])
    assert drawn["weights.png"].count("▼\nowner") == 4
    assert drawn["weights.png"].count("0.80") == 2
    # The largest of each object, beside the owners' own.
    assert drawn["weights.png"].count("1.00") == 4
    assert {"from the red neuron to:", "from the green neuron to:"} < set(drawn["weights_over_time.png"])
    assert {"input, 9.0 s into learning", "input, 10.0 s into learning"} < set(drawn["frames.png"])
    assert drawn["outputs.png"].count("owns an object") == 2
    assert set(ndtorch.FEATURES) < set(drawn["outputs.png"])  # a lane for each


def test_no_objects_and_no_samples(result: RunResult, drawn: dict[str, list[str]], tmp_path: Path) -> None:
    empty = dataclasses.replace(
        with_weights(result, torch.zeros(10, 10)),
        verdict="static",
        outputs=Trace((10,)),
        weights=Trace((10, 10)),
        moments={},
        interrupted=True,
        simulated_seconds=0.02,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plots.draw_all(empty, tmp_path)
    assert any(text.startswith("STATIC") and "interrupted" in text for text in drawn["outputs.png"])
    assert {"all weights are zero", "no objects"} < set(drawn["weights.png"])
    assert "No object won the model's attention in this run." in drawn["frames.png"]
    assert "no samples" in drawn["outputs.png"]


def test_thinned_keeps_every_peak() -> None:
    times = np.arange(10_007) / 100
    values = np.zeros(10_007, dtype=np.float32)
    values[[3, 5000, 10_006]] = [1, -2, 3]
    x, y = thinned(times, values)
    assert len(x) <= POINTS + 20
    assert sorted(y[y != 0].tolist()) == [-2, 1, 3]
    assert (np.diff(x) > 0).all()
    assert x[0] == times[0]
    assert x[-1] == times[-1]
