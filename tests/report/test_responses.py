"""Responses over time: the table holds what the model computed, the arrays have names."""

from pathlib import Path

import numpy as np
import pytest
import torch

import ndtorch
from ndtorch.errors import InputError
from ndtorch.report.responses import NAMES, ResponseFile, to_xarray
from ndtorch.run.run import run_model
from ndtorch.scenes import two_bars


def test_the_table_has_every_step_and_an_answer_a_second(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    scene = two_bars(seconds=2.5, size=(96, 96), fps=25)
    model = ndtorch.load("scale-free", size=scene.size, fps=scene.fps)
    file = ResponseFile(tmp_path / "responses.parquet", model)
    result = run_model(model, scene, pictures_per_second=0, watchers=(file,))
    file.close()
    assert file.trouble is None
    table = parquet.read_table(tmp_path / "responses.parquet").to_pydict()
    with torch.inference_mode():
        signals, _ = model(scene.frames(0, scene.length))
    assert table["time"] == pytest.approx(signals.time.tolist())
    for kind, values in (("input", signals.inputs), ("output", signals.outputs)):
        found = np.stack([table[f"{kind}_{name}"] for name in NAMES], -1)
        np.testing.assert_allclose(found, values.numpy(), atol=1e-6)
    answers = [row for row in zip(table["objects"], table["weights"], strict=True) if row[0] is not None]
    assert 2 <= len(answers) <= 4
    assert np.shape(answers[-1][1]) == (100,)
    assert all(0 <= value <= 1 for value in table["confidence"] if value is not None)
    assert result.frames == scene.length


def test_arrays_have_trials_times_and_features() -> None:
    xarray = pytest.importorskip("xarray")
    model = ndtorch.load("published", size=(48, 48), fps=100)
    with torch.inference_mode():
        signals, _ = model(torch.rand(2, 20, 3, 48, 48))
    data = to_xarray(signals)
    assert isinstance(data, xarray.Dataset)
    assert dict(data.sizes) == {"trial": 2, "time": len(signals.time), "feature": 10}
    red = data.sums.sel(feature="red", trial=1).values
    np.testing.assert_array_equal(red, signals.sums[1, :, 7].numpy())


def test_other_signals_are_refused() -> None:
    with pytest.raises(InputError, match="signals must be"):
        to_xarray(torch.rand(5, 10))  # type: ignore[arg-type]
