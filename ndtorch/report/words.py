"""What a run found, for people and for programs."""

from __future__ import annotations

from typing import Any

from ndtorch.binding import describe, spectral_radius
from ndtorch.run.result import BindResult
from ndtorch.vision import FEATURES

VERDICTS = {
    "stable": "stable: the weights have settled",
    "learning": "learning: the weights have not settled (yet); take the table as provisional",
    "alternating": "alternating: the outputs flip sign from step to step, so the weights mean nothing; lower --gamma",
    "static": "static: nothing fluctuates enough to bind features by",
}

NOTHING_LEARNED = "learning: no weight has grown far enough yet to make a table of"


def summary(result: BindResult) -> dict[str, Any]:
    """What `--json` prints."""
    weights = result.state.second.weights.detach().cpu()
    return {
        "source": result.source,
        "objects": [{"neuron": thing.neuron, "features": thing.features} for thing in result.objects],
        "verdict": result.verdict,
        "max_weight": float(weights.max()),
        "spectral_radius": float(spectral_radius(weights)),
        "weights": weights.tolist(),
        "simulated_seconds": result.simulated_seconds,
        "wall_seconds": result.wall_seconds,
        "frames_per_second": result.frames / result.wall_seconds,
    }


def in_words(result: BindResult) -> str:
    """The table of objects and the verdict, as text for people."""
    lines = [f"{result.source}: {result.simulated_seconds:g} s seen in {result.wall_seconds:.1f} s", ""]
    for number, thing in enumerate(result.objects, 1):
        lines.append(f"object {number}: {describe(thing)}")
    if not result.objects:
        lines.append("no objects")
    else:
        lines += ["", "neuron  " + "".join(f"{name:>7}" for name in FEATURES)]
        for thing in result.objects:
            cells = (f"{thing.features[n]:7.2f}" if n in thing.features else f"{'.':>7}" for n in FEATURES)
            lines.append(f"{thing.neuron:8}" + "".join(cells))
    untaught = result.verdict == "learning" and not result.objects
    lines += ["", f"verdict  {NOTHING_LEARNED if untaught else VERDICTS[result.verdict]}"]
    if result.interrupted:
        lines.append(f"stopped early, after {result.simulated_seconds:g} s; what was computed so far is kept")
    return "\n".join(lines)
