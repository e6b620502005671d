"""What a run found, as plain data and as text."""

from __future__ import annotations

from typing import Any

import torch

from ndtorch.binding import BoundObject, describe, spectral_radius
from ndtorch.report.tracks import TrackRecord
from ndtorch.run.result import RunResult

VERDICTS = {
    "stable": "stable: the weights have settled, which does not say that the objects are right",
    "learning": "learning: the weights have not settled (yet); take the table as provisional",
    "alternating": "alternating: the outputs flip sign from step to step, so the weights mean nothing; lower gamma",
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


def findings(result: RunResult) -> list[str]:
    """The objects and what they are worth as text for people, a line each."""
    lines = []
    for thing in result.objects:
        known = thing.first_seen is not None and thing.last_seen is not None
        seen = f"{thing.first_seen:5.1f} - {thing.last_seen:5.1f} s  " if known else ""
        lines.append(f"object {thing.number}: {seen}{words(thing)}")
    states = [state for thing in result.objects for state in thing.states]
    merged = states.count("predicted") / max(1, len(states))
    if not result.model.tracks:
        verdict = VERDICTS[result.verdict]
        if result.verdict == "learning" and not result.objects:
            verdict = "learning: no weight has grown far enough yet to make a table of"
        elif result.confidence is not None and result.verdict in ("stable", "learning"):
            sure = f"the number of objects is right with a probability of {result.confidence:.2f}"
            verdict = f"{result.verdict}: {sure}"
        lines.append(f"verdict  {verdict}")
    elif not result.objects:
        lines.append(f"note: {NOTHING_MOVED}")
    elif merged >= MIN_MERGED:
        shared = f"objects overlap in {merged:.0%} of their rows (state predicted)"
        lines.append(f"note: {shared}; those that are never apart are one object")
    lines += [f"new scene at {time:.1f} s" for time in result.cuts]
    if result.interrupted:
        lines.append(f"stopped early, after {result.simulated_seconds:g} s; what was computed so far is kept")
    return lines if result.objects else ["no objects", *lines]


def words(thing: BoundObject) -> str:
    """What an object looked like: a track its color and direction, an owner all of its features."""
    if thing.first_seen is None:
        return describe(thing)
    return f"{thing.color}, moving {thing.direction}" if thing.direction else thing.color
