"""What a run found, for people and for programs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch

from ndtorch.binding import BoundObject, describe, spectral_radius
from ndtorch.run.result import RunResult
from ndtorch.vision import FEATURES

VERDICTS = {
    "stable": "stable: the weights have settled, which does not say that the objects are right",
    "learning": "learning: the weights have not settled (yet); take the table as provisional",
    "alternating": "alternating: the outputs flip sign from step to step, so the weights mean nothing; lower --gamma",
    "static": "static: nothing fluctuates enough to bind features by",
}

SURE = {
    "stable": "stable: the number of objects is right with a probability of {:.2f}",
    "learning": "learning: the number of objects is right with a probability of {:.2f} only",
}
"""The same of models that know how likely they are right."""

NOTHING_LEARNED = "learning: no weight has grown far enough yet to make a table of"

PATH_HZ = 5.0
"""Places written of every object a second."""


def summary(result: RunResult) -> dict[str, Any]:
    """What `--json` prints and objects.json holds."""
    weights = torch.from_numpy(result.final_weights)
    return {
        "source": result.source,
        "model": result.model,
        "objects": [record(number, thing, result.size) for number, thing in numbered(result.objects)],
        "advice": list(result.advice),
        "cuts": [round(time, 3) for time in result.cuts],
        "verdict": result.verdict,
        "confidence": result.confidence,
        "max_weight": float(weights.max()),
        "spectral_radius": float(spectral_radius(weights)),
        "weights": weights.tolist(),
        "simulated_seconds": result.simulated_seconds,
        "wall_seconds": result.wall_seconds,
        "frames_per_second": result.frames / max(result.wall_seconds, 1e-9),
    }


def numbered(things: Sequence[BoundObject]) -> list[tuple[int, BoundObject]]:
    """The objects with their numbers, from 1 in the order in which they appeared, which the overlay shows too."""
    return [(place if thing.number is None else thing.number, thing) for place, thing in enumerate(things, 1)]


def record(number: int, thing: BoundObject, size: tuple[int, int]) -> dict[str, Any]:
    """One object as plain data; places are row and column as shares of the picture's height and width."""
    if thing.place is None or thing.first_seen is None or thing.last_seen is None:
        sure = {} if thing.confidence is None else {"confidence": thing.confidence}
        return {"neuron": thing.neuron, "features": thing.features, **sure}
    path: list[list[float]] = []
    boxes: list[list[float]] = []
    for n, (time, column, row) in enumerate(thing.path):
        if not path or time - path[-1][0] >= 1 / PATH_HZ - 1e-6:
            path.append([round(time, 3), round(row / size[0], 3), round(column / size[1], 3)])
            if thing.boxes:
                left, top, right, bottom = thing.boxes[n]
                sides = (top / size[0], left / size[1], bottom / size[0], right / size[1])
                boxes.append([round(side, 3) for side in sides])
    found: dict[str, Any] = {
        "object": number,
        "color": thing.color,
        "direction": thing.direction,
        "appeared": round(thing.first_seen, 3),
        "disappeared": round(thing.last_seen, 3),
        "neuron": thing.neuron,
        **({} if thing.confidence is None else {"confidence": thing.confidence}),
        "features": {name: round(value, 3) for name, value in thing.features.items()},
        "path": path,
    }
    if boxes:
        # Top, left, bottom and right at every place of the path, as shares of the picture.
        found["boxes"] = boxes
    return found


def in_words(result: RunResult) -> str:
    """The objects and the verdict, as text for people."""
    lines = [f"{result.source}: {result.simulated_seconds:g} s seen in {result.wall_seconds:.1f} s", ""]
    lines += [f"object {number}: {words(thing)}" for number, thing in numbered(result.objects)]
    if result.earlier:
        lines.append(f"{result.earlier} earlier objects are in timeline.jsonl alone")
    if not result.objects:
        lines.append("no objects")
    lines += [f"note: {line}" for line in result.advice]
    if result.table is not None:
        if result.objects:
            lines += ["", *table(result.objects)]
        lines += ["", f"verdict  {verdict_words(result)}"]
    lines += [f"new scene at {time:.1f} s" for time in result.cuts]
    if result.interrupted:
        lines.append(f"stopped early, after {result.simulated_seconds:g} s; what was computed so far is kept")
    return "\n".join(lines)


def verdict_words(result: RunResult) -> str:
    """What the objects are worth."""
    if result.verdict == "learning" and not result.objects:
        return NOTHING_LEARNED
    if result.confidence is not None and result.verdict in SURE:
        return SURE[result.verdict].format(result.confidence)
    return VERDICTS[result.verdict]


def words(thing: BoundObject) -> str:
    """One object: when, and what it looked like, or its features where no time is known."""
    if thing.first_seen is None or thing.last_seen is None:
        return describe(thing)
    moving = f"moving {thing.direction}" if thing.direction else "no direction of motion"
    return f"{thing.first_seen:5.1f} - {thing.last_seen:5.1f} s  {thing.color}, {moving}"


def table(things: list[BoundObject]) -> list[str]:
    """The features of every object, a row each."""
    sure = [] if any(thing.confidence is None for thing in things) else ["confidence"]
    lines = ["neuron  " + "".join(f"{name:>7}" for name in FEATURES) + "".join(f"{name:>12}" for name in sure)]
    for thing in things:
        cells = (f"{thing.features[n]:7.2f}" if n in thing.features else f"{'.':>7}" for n in FEATURES)
        confidence = f"{thing.confidence:12.2f}" if sure else ""
        lines.append(f"{thing.neuron:8}" + "".join(cells) + confidence)
    return lines
