"""Scoring `ndtorch bind` on generated video with known truth: number of objects and main direction of each."""

from __future__ import annotations

import itertools
import tempfile
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import ndtorch
from ndtorch.binding import BoundObject
from ndtorch.binding.models.video import switched_off
from ndtorch.files import replacing, write_text
from ndtorch.run.opening import CAMERA_MODELS
from ndtorch.run.result import RunResult
from ndtorch.run.run import run_model
from ndtorch.scenes.video import open_video
from ndtorch_train.score.choices import Split
from ndtorch_train.score.metrics import share
from ndtorch_train.score.video_clips import Clip, draw_clip, truth
from ndtorch_train.score.video_encode import encode
from ndtorch_train.score.video_paint import Painter
from ndtorch_train.score.whole_field import WholeFieldWatcher


@dataclass(frozen=True)
class ClipScore:
    """How one clip came out.

    Attributes:
        name: of the clip; count, fps: what it holds and at what rate.
        found: number of objects reported.
        right: the number is right, and every object has one reported that was in sight when it was and moves its way.
        colored: and the strongest color of each is the one its color has most of.
        away: mean distance of the reported places from the true ones, heights of the picture; NaN unless `right`.
        cost: seconds of wall time a second of video, decoding included.
    """

    name: str
    count: int
    fps: float
    found: int
    right: bool
    colored: bool
    away: float
    cost: float


def clip_file(clip: Clip, folder: Path) -> tuple[Path, str]:
    """The clip as a video file in `folder`, encoded unless it is there already, and the encoder used."""
    path = folder / f"{clip.name}.mp4"
    note = path.with_suffix(".codec")
    if path.exists():
        return path, note.read_text(encoding="utf-8") if note.exists() else "libx264"
    with replacing(path) as part:
        used = encode(Painter(clip).frames(), part, clip.fps, clip.size, clip.quality)
        write_text(note, used)
    return path, used


def score_clip(clip: Clip, path: Path, without: Sequence[str] = ()) -> ClipScore:
    """Run the whole of `ndtorch bind` on a clip's file, less its pictures, and compare with the truth."""
    began = time.perf_counter()
    result = run_video(path, without)
    wall = time.perf_counter() - began
    return compare(clip, result, wall / clip.seconds)


def run_video(path: Path, without: Sequence[str] = ()) -> RunResult:
    """The model video over a file, without pictures."""
    rows = CAMERA_MODELS["video"]
    source = open_video(path, (rows, rows), fit="reduce")
    model = ndtorch.load("video", size=source.size, fps=source.fps, **switched_off(without))
    if "fields" not in without:
        return run_model(model, source, pictures_per_second=0)
    watcher = WholeFieldWatcher(model.dt, source.size)
    result = run_model(model, source, pictures_per_second=0, watchers=(watcher,))
    return replace(result, objects=watcher.objects())


def compare(clip: Clip, result: RunResult, cost: float = 0.0) -> ClipScore:
    """A result against the truth of its clip."""
    known = truth(clip)["objects"]
    best: tuple[bool, bool, float] = (False, False, float("nan"))
    if len(result.objects) == len(known):
        for found in itertools.permutations(result.objects):
            pairs = list(zip(found, known, strict=True))
            if not all(matches(thing, real) for thing, real in pairs):
                continue
            colored = all(is_colored(thing, real) for thing, real in pairs)
            away = [distance(thing, real, result.size) for thing, real in pairs]
            best = max(best, (True, colored, float(np.mean(away)) if away else 0.0), key=lambda b: (b[0], b[1]))
    return ClipScore(clip.name, clip.count, clip.fps, len(result.objects), *best, cost)


def matches(thing: BoundObject, real: dict[str, Any]) -> bool:
    """Whether a reported object moves as the real one does and was in sight while that was."""
    if thing.first_seen is None or thing.last_seen is None:
        return False
    overlap = thing.first_seen <= real["times"][-1] and thing.last_seen >= real["times"][0]
    return bool(overlap and thing.direction == real["direction"])


def is_colored(thing: BoundObject, real: dict[str, Any]) -> bool:
    """Whether its strongest color is the largest of the real one's red, green and blue, or nearly."""
    color = dict(zip(("red", "green", "blue"), real["color"], strict=True))
    return bool(color.get(thing.color, 0.0) >= 0.9 * max(color.values()))


def distance(thing: BoundObject, real: dict[str, Any], size: tuple[int, int]) -> float:
    """Mean distance of reported from true places while both are known, heights of the picture."""
    height, width = size
    at = {round(t, 1): place for t, place in zip(real["times"], real["places"], strict=True)}
    apart = [
        float(np.hypot(row / height - at[key][0], column / height - at[key][1] * width / height))
        for t, column, row in thing.path
        if (key := round(t, 1)) in at
    ]
    return float(np.mean(apart)) if apart else float("nan")


def score_clips(
    split: Split,
    counts: Iterable[int],
    rates: Iterable[float],
    clips: int,
    without: Sequence[str] = (),
    folder: Path | None = None,
) -> tuple[list[ClipScore], set[str]]:
    """Scores of `clips` clips of every count and rate, and the encoders used. Files stay in `folder`, if given."""
    scores: list[ClipScore] = []
    codecs: set[str] = set()
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch) if folder is None else folder
        place.mkdir(parents=True, exist_ok=True)
        for number, fps, count in itertools.product(range(clips), rates, counts):
            clip = draw_clip(split, number, count, fps)
            path, used = clip_file(clip, place)
            codecs.add(used)
            scores.append(score_clip(clip, path, without))
            if folder is None:
                path.unlink()
    return scores, codecs


def table(scores: Sequence[ClipScore]) -> str:
    """Markdown: share of clips right (count and directions) by number of objects and rate, ± standard error."""
    rates = sorted({s.fps for s in scores})
    head = "| objects | " + " | ".join(f"{fps:g} fps" for fps in rates) + " | all | count alone | colors too | away |"
    lines = [head, "|" + "---|" * (len(rates) + 5)]
    for count in sorted({s.count for s in scores}):
        rows = [s for s in scores if s.count == count]
        cells = [cell([s.right for s in rows if s.fps == fps]) for fps in rates]
        away = [s.away for s in rows if s.right and count]
        lines.append(
            f"| {count} | {' | '.join(cells)} | {cell([s.right for s in rows])} | "
            f"{cell([s.found == s.count for s in rows])} | {cell([s.colored for s in rows]) if count else '-'} | "
            f"{f'{np.mean(away):.2f}' if away else '-'} |"
        )
    return "\n".join(lines) + "\n"


def cell(values: Sequence[bool]) -> str:
    """Share, its standard error and the number of clips."""
    if not values:
        return "-"
    mean, error = share(list(values))
    return f"{mean:.2f} ± {error:.2f} ({len(values)})"
