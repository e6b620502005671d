"""What a run found, as plain data and as text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch

from ndtorch.binding import BoundObject, describe, spectral_radius
from ndtorch.report.tracks import TrackRecord
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

MIN_MERGED = 0.1
"""From this share of rows in which objects overlap, the note says so."""

PATH_HZ = 5.0
"""Rows of every object a second in objects.json."""


def summary(result: RunResult, tracks: TrackRecord | None = None) -> dict[str, Any]:
    """What `--json` prints and objects.json holds."""
    weights = torch.from_numpy(result.final_weights)
    return {
        "source": result.source.name,
        "model": result.model.name,
        "objects": [as_data(thing, tracks) for thing in result.objects],
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


def as_data(thing: BoundObject, tracks: TrackRecord | None) -> dict[str, Any]:
    """One object as plain data; of tracks with rows of the record, at most `PATH_HZ` a second."""
    features = {name: round(value, 3) for name, value in thing.features.items()}
    sure = {} if thing.confidence is None else {"confidence": thing.confidence}
    if tracks is None or thing.number is None:
        return {"neuron": thing.neuron, "features": features, **sure}
    columns = (tracks.frame, tracks.time.round(3), tracks.box.round(2), tracks.state)
    heads = ("frame", "time", "box", "state")
    rows = tracks.rows_of(thing.number, 1 / PATH_HZ)
    return {
        "object": thing.number,
        "color": thing.color,
        "direction": thing.direction,
        "appeared": round(thing.first_seen or 0.0, 3),
        "disappeared": round(thing.last_seen or 0.0, 3),
        **sure,
        "features": features,
        "path": [dict(zip(heads, (column[k].tolist() for column in columns), strict=True)) for k in rows],
    }


def in_words(result: RunResult) -> str:
    """The objects and the verdict, as text for people."""
    lines = [f"{result.source.name}: {result.simulated_seconds:g} s seen in {result.wall_seconds:.1f} s", ""]
    lines += [f"object {thing.number}: {span(thing)}{words(thing)}" for thing in result.objects]
    if not result.objects:
        lines.append("no objects")
    if not result.model.tracks:
        heads, rows = features_table(result.objects)
        if rows:
            lines += [
                "",
                heads[0].ljust(8) + "".join(f"{head:>12}" if head[0] == "c" else f"{head:>7}" for head in heads[1:]),
            ]
            lines += [row[0].ljust(8) + "".join(f"{cell or '.':>7}" for cell in row[1:]) for row in rows]
        lines += ["", f"verdict  {verdict_words(result)}"]
    elif note := note_of(result):
        lines.append(f"note: {note}")
    lines += [f"new scene at {time:.1f} s" for time in result.cuts]
    if result.interrupted:
        lines.append(f"stopped early, after {result.simulated_seconds:g} s; what was computed so far is kept")
    return "\n".join(lines)


def note_of(result: RunResult) -> str:
    """What to know of the tracks of a run before they are used; empty if nothing."""
    states = [state for thing in result.objects for state in thing.states]
    merged = states.count("predicted") / max(1, len(states))
    if merged < MIN_MERGED:
        return "" if result.objects else NOTHING_MOVED
    return f"objects overlap in {merged:.0%} of their rows (state predicted); those that are never apart are one object"


def verdict_words(result: RunResult) -> str:
    """What the objects are worth."""
    if result.verdict == "learning" and not result.objects:
        return "learning: no weight has grown far enough yet to make a table of"
    if result.confidence is not None and result.verdict in ("stable", "learning"):
        return f"{result.verdict}: the number of objects is right with a probability of {result.confidence:.2f}"
    return VERDICTS[result.verdict]


def span(thing: BoundObject) -> str:
    """When an object was in sight; nothing where no time is known."""
    known = thing.first_seen is not None and thing.last_seen is not None
    return f"{thing.first_seen:5.1f} - {thing.last_seen:5.1f} s  " if known else ""


def words(thing: BoundObject) -> str:
    """What an object looked like: a track its color and direction, an owner all of its features."""
    if thing.first_seen is None:
        return describe(thing)
    return f"{thing.color}, moving {thing.direction}" if thing.direction else thing.color


def features_table(things: Sequence[BoundObject]) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of a table: a row an object, a column a feature, empty where it has none of it."""
    sure = bool(things) and all(thing.confidence is not None for thing in things)
    first = "neuron" if not things or things[0].first_seen is None else "color"
    heads = [first, *FEATURES, *["confidence"] * sure]
    rows = []
    for thing in things:
        cells = [f"{thing.features[name]:.2f}" if name in thing.features else "" for name in FEATURES]
        rows.append(
            [thing.neuron if first == "neuron" else thing.color, *cells, *[f"{thing.confidence or 0:.2f}"] * sure]
        )
    return heads, rows
