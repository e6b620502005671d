"""Tuning curves against the formulas of the field."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import pytest
import torch

from ndtorch.cli.tuning import Tuning
from ndtorch.errors import InputError
from ndtorch.vision.tuning import USUAL_VALUES, gains, tuning_curve

FREQUENCIES = USUAL_VALUES["temporal_frequency"]


@pytest.mark.parametrize("kind", ["euler", "exact"])
@pytest.mark.parametrize(
    ("detector", "over"),
    [
        ("hassenstein-reichardt", {"temporal_frequency": FREQUENCIES[:16], "wavelength": [2.5, 4.0, 30.0]}),
        ("hassenstein-reichardt", {"direction": [0.0, 50.0, 90.0, 180.0], "contrast": [0.1, 1.0]}),
        ("nd-min", {"temporal_frequency": FREQUENCIES[:16], "tau_high": [0.005, 0.1]}),
        ("nd-minus", {"wavelength": [3.0, 8.0, 40.0]}),
        ("nds", {"wavelength": [3.0, 8.0, 40.0], "tau_low": [0.0, 0.02]}),
        ("chahl-srinivasan", {"speed": [-3.0, 0.2, 1.0, 2.5], "wavelength": [4.5, 20.0]}),
        ("oriented-dog", {"direction": [0.0, 20.0, 90.0], "wavelength": [30.0, 60.0]}),
    ],
)
def test_detectors_follow_their_formulas(detector: str, over: dict[str, list[float]], kind: str) -> None:
    curve = tuning_curve(detector, over, kind)  # type: ignore[arg-type]
    formula = curve.formulas.get("discrete", curve.formulas.get("formula"))
    assert formula is not None
    assert float((curve.response - formula).abs().max()) < 5e-5 * float(formula.abs().max())
    assert float(formula.abs().max()) > 1e-4


@pytest.mark.parametrize(
    ("kind", "fps", "best"), [("euler", 25, 2.29), ("euler", 30, 2.41), ("exact", 25, 2.95), ("exact", 200, 3.24)]
)
def test_best_temporal_frequency(kind: str, fps: float, best: float) -> None:
    near = [best - 0.04, best, best + 0.04]
    curve = tuning_curve("hassenstein-reichardt", {"temporal_frequency": near}, kind, fps=fps)  # type: ignore[arg-type]
    assert int(curve.response.argmax()) == 1


def test_the_best_frequency_of_a_delay_alone() -> None:
    """`1 / (2 pi tau)`; in steps `cos w = 1 / cosh(dt / tau)` with exact filters."""
    near = [0.01 * n for n in range(250, 340)]
    grid = {name: torch.full((90,), value).double() for name, value in (("fps", 30.0), ("tau_low", 0.05))}
    grid |= {
        "temporal_frequency": torch.tensor(near).double(),
        "wavelength": torch.ones(90),
        "direction": torch.ones(90),
    }
    for kind, want in ((None, 1 / (0.1 * math.pi)), ("exact", 30 / (2 * math.pi) * math.acos(1 / math.cosh(2 / 3)))):
        _, delay, _ = gains(grid, kind)  # type: ignore[arg-type]
        assert near[int(delay.imag.argmin())] == pytest.approx(want, abs=0.006)


def test_a_curve_is_a_table_and_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ("temporal_frequency=1,2.5", "wavelength=10,20,40")
    assert Tuning("hassenstein-reichardt", given, ("fps=30",), out=tmp_path).run() == 0
    assert "largest response" in capsys.readouterr().out
    with (tmp_path / "tuning-hassenstein-reichardt" / "curve.csv").open() as file:
        rows = list(csv.DictReader(file))
    curve = tuning_curve("hassenstein-reichardt", {"temporal_frequency": [1, 2.5], "wavelength": [10, 20, 40]}, fps=30)
    assert [float(row["response"]) for row in rows] == pytest.approx(curve.response.flatten().tolist())
    assert [float(row["wavelength"]) for row in rows] == [10, 20, 40] * 2
    assert (tmp_path / "tuning-hassenstein-reichardt" / "curve.png").stat().st_size > 10_000
    for wrong in (("wavelenght",), ("speed=1",), ("wavelength=a",)):
        with pytest.raises(InputError):
            Tuning("hassenstein-reichardt", wrong, out=tmp_path).run()
    xarray = pytest.importorskip("xarray")
    found = curve.to_xarray()
    assert isinstance(found, xarray.Dataset)
    torch.testing.assert_close(
        found["response"].sel(wavelength=20, temporal_frequency=2.5).item(), float(curve.response[1, 1])
    )
