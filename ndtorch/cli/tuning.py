"""`ndtorch tuning`: the tuning curve of a detector."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro


@dataclass(frozen=True)
class Tuning:
    """Measure the tuning curve of a detector: its response to drifting gratings over a grid, beside the formula.

    Writes curve.csv, curve.parquet and curve.png into a folder. `--over temporal_frequency wavelength` takes usual
    values, `--over temporal_frequency=1,2,4` these.
    """

    detector: Annotated[str, tyro.conf.Positional] = "hassenstein-reichardt"
    """Detector: hassenstein-reichardt, barlow-levick, nd-min, nd-minus, nds, chahl-srinivasan or oriented-dog."""
    over: tuple[str, ...] = ("temporal_frequency",)
    """Parameters that vary: temporal_frequency, wavelength, direction, contrast, speed, fps, tau_high, tau_low."""
    set: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Value of another parameter, as fps=30; any number of times."""
    discretization: Literal["euler", "exact"] = "euler"
    """Filters: as published, or 1 - exp(-dt / tau)."""
    out: Path = Path("out")
    """Folder for results; a curve gets a new folder in it."""
    force: bool = False
    """Write into the folder named after the detector even if results are there."""

    def run(self) -> int:
        from ndtorch.errors import InputError
        from ndtorch.report.exports import write_table
        from ndtorch.report.plots import draw_tuning
        from ndtorch.run.folder import RunFolder
        from ndtorch.run.options import values_of
        from ndtorch.vision.tuning import USUAL_VALUES, tuning_curve

        over = {}
        for one in self.over:
            name, _, text = one.partition("=")
            try:
                over[name] = [float(part) for part in text.split(",")] if text else USUAL_VALUES.get(name, [])
            except ValueError:
                raise InputError(f"--over takes NAME or NAME=1,2,4, got {one!r}") from None
        constants = values_of(self.set)
        if wrong := [name for name, value in constants.items() if type(value) not in (int, float)]:
            raise InputError(f"--set {wrong[0]} must be a number, got {constants[wrong[0]]!r}")
        curve = tuning_curve(self.detector, over, self.discretization, **constants)
        folder, table = RunFolder(self.out / f"tuning-{self.detector}", self.force), curve.table()
        try:
            for name in ("curve.csv", "curve.parquet"):
                write_table(table, folder.work / name)
            draw_tuning(curve, folder.work / "curve.png")
        except BaseException:
            folder.discard()
            raise
        files = folder.publish()
        best = int(curve.response.argmax())
        at = ", ".join(f"{name} {table[name][best]:g}" for name in curve.axes)
        print(f"{curve.detector}: largest response {table['response'][best]:.4g} at {at}")
        for name, formula in curve.formulas.items():
            error = float((curve.response - formula).abs().max() / formula.abs().max())
            print(f"{name}: differs by {100 * error:.2g} % of its largest value at most")
        print(f"written  {folder.final}: {', '.join(path.name for path in files)}")
        return 0
