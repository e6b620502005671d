"""The pictures of one binding run, drawn with matplotlib into PNG files, after [B fig. 8, 10], [C fig. 6].

Time on every axis counts from the start of second-stage learning, as in the papers; time before is shaded.
"""

from __future__ import annotations

from pathlib import Path

from ndtorch.report.plots.attention import draw_frames
from ndtorch.report.plots.signals import draw_outputs
from ndtorch.report.plots.weights import draw_weights, draw_weights_over_time
from ndtorch.run.result import RunResult


def draw_all(result: RunResult, folder: str | Path) -> list[Path]:
    """Write outputs.png, weights.png, weights_over_time.png and frames.png into `folder`, made if missing."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    drawings = {
        "outputs": draw_outputs,
        "weights": draw_weights,
        "weights_over_time": draw_weights_over_time,
        "frames": draw_frames,
    }
    return [draw(result, folder / f"{name}.png") for name, draw in drawings.items()]
