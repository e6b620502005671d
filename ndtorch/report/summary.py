"""What a run found, as plain data and as text."""

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

NOTHING_MOVED = (
    "no region that differed from the background travelled for long enough: the camera must stand still, the "
    "background takes half a second to learn, and an object must be followed for about a second"
)

PATH_HZ = 5.0
"""Places written of every object a second."""


def summary(result: RunResult) -> dict[str, Any]:
    """What `--json` prints and objects.json holds."""
    weights = torch.from_numpy(result.final_weights)
    return {
        "source": result.source,
        "model": result.model,
        "objects": [record(number, thing, result.size) for number, thing in numbered(result.objects)],
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
    """One object as plain data; places are row and column, boxes top, left, bottom and right, as shares of the
    picture's height and width."""
    sure = {} if thing.confidence is None else {"confidence": thing.confidence}
    if thing.place is None or thing.first_seen is None or thing.last_seen is None:
        return {"neuron": thing.neuron, "features": thing.features, **sure}
    chosen: list[int] = []
    for n, (time, *_) in enumerate(thing.path):
        if not chosen or time - thing.path[chosen[-1]][0] >= 1 / PATH_HZ - 1e-6:
            chosen.append(n)
    height, width = size
    path = [thing.path[n] for n in chosen]
    boxes = [thing.boxes[n] for n in chosen] if thing.boxes else []
    shares = [[round(y, 3) for y in (b / height, a / width, d / height, c / width)] for a, b, c, d in boxes]
    return {
        "object": number,
        "color": thing.color,
        "direction": thing.direction,
        "appeared": round(thing.first_seen, 3),
        "disappeared": round(thing.last_seen, 3),
        "neuron": thing.neuron,
        **sure,
        "features": {name: round(value, 3) for name, value in thing.features.items()},
        "path": [[round(time, 3), round(y / height, 3), round(x / width, 3)] for time, x, y in path],
        **({"boxes": shares} if shares else {}),
    }


def in_words(result: RunResult) -> str:
    """The objects and the verdict, as text for people."""
    lines = [f"{result.source}: {result.simulated_seconds:g} s seen in {result.wall_seconds:.1f} s", ""]
    lines += [f"object {number}: {words(thing)}" for number, thing in numbered(result.objects)]
    if result.earlier:
        lines.append(f"{result.earlier} earlier objects are in timeline.jsonl alone")
    if not result.objects:
        lines.append("no objects")
    if result.table is not None:
        heads, rows = features_table(result.objects)
        if rows:
            lines += [
                "",
                heads[0].ljust(8) + "".join(f"{head:>12}" if head[0] == "c" else f"{head:>7}" for head in heads[1:]),
            ]
            lines += [row[0].ljust(8) + "".join(f"{cell or '.':>7}" for cell in row[1:]) for row in rows]
        lines += ["", f"verdict  {verdict_words(result)}"]
    elif not result.objects:
        lines.append(f"note: {NOTHING_MOVED}")
    lines += [f"new scene at {time:.1f} s" for time in result.cuts]
    if result.interrupted:
        lines.append(f"stopped early, after {result.simulated_seconds:g} s; what was computed so far is kept")
    return "\n".join(lines)


def verdict_words(result: RunResult) -> str:
    """What the objects are worth."""
    if result.verdict == "learning" and not result.objects:
        return "learning: no weight has grown far enough yet to make a table of"
    if result.confidence is not None and result.verdict in ("stable", "learning"):
        return f"{result.verdict}: the number of objects is right with a probability of {result.confidence:.2f}"
    return VERDICTS[result.verdict]


def words(thing: BoundObject) -> str:
    """One object: when, and what it looked like, or its features where no time is known."""
    if thing.first_seen is None or thing.last_seen is None:
        return describe(thing)
    moving = f"moving {thing.direction}" if thing.direction else "no direction of motion"
    return f"{thing.first_seen:5.1f} - {thing.last_seen:5.1f} s  {thing.color}, {moving}"


def features_table(things: Sequence[BoundObject]) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of a table: a row an object, a column a feature, empty where it has none of it."""
    sure = bool(things) and all(thing.confidence is not None for thing in things)
    heads = ["neuron", *FEATURES, *["confidence"] * sure]
    rows = []
    for thing in things:
        cells = [f"{thing.features[name]:.2f}" if name in thing.features else "" for name in FEATURES]
        rows.append([thing.neuron, *cells, *[f"{thing.confidence or 0:.2f}"] * sure])
    return heads, rows
