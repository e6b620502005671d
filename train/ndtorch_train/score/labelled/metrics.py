"""What a method's sights are worth against the truth. A sight is right if its place is inside a true box or blob."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ndtorch_train.score.labelled.sight import Seen, Sight
from ndtorch_train.score.labelled.truth import Real, RealBox, RealFrame

KEPT = 0.01
"""What a pair of the frame before is worth more than a new one: less than any other match."""
TRAVELLED = 1.0
"""Own sizes a true object has to go to have a main direction."""


@dataclass(frozen=True)
class Score:
    """Scores of one method on one clip; None where the truth cannot tell.

    Attributes:
        precision, recall, f: of places.
        idf1: harmonic mean of precision and recall under the best one-to-one pairing of identities.
        mota: 1 - (missed + false + switches) / true.
        switches: a true object changes its track.
        fragments: times that a true object is lost and found again.
        count_error: mean absolute difference of the numbers of objects.
        direction: share of the true objects that travel whose best track has the same main direction.
        mask_f: of pixels.
        false_per_minute: tracks that begin where nothing is true, per minute of such time.
        ms_per_frame: processor time.
    """

    precision: float
    recall: float
    f: float
    idf1: float | None
    mota: float | None
    switches: int | None
    fragments: int | None
    count_error: float
    direction: float | None
    mask_f: float | None
    false_per_minute: float | None
    ms_per_frame: float


@dataclass
class Tally:
    """Sums over frames."""

    true: int = 0
    said: int = 0
    right: int = 0
    switches: int = 0
    fragments: int = 0
    away: int = 0
    frames: int = 0
    empty: int = 0


def score(seen: Seen, truth: Iterable[RealFrame], fps: float, masked: bool) -> Score:
    """All scores of a method's sights of one clip.

    Args:
        seen: of every frame of the clip.
        truth: of the same frames; one that ends early ends the score, unless it never began.
        fps: frames a second.
        masked: whether the truth is masks, so that identities are not known.
    """
    tally, together = Tally(), Counter[tuple[int, int]]()
    lasting: dict[int, int] = {}
    found_before: set[int] = set()
    paths: dict[int, list[tuple[float, float]]] = {}
    sizes: dict[int, float] = {}
    begun: set[int] = set()
    false_tracks = 0
    pixels = np.zeros(3, np.int64)
    real = iter(truth)
    empty = RealFrame([])
    for number, sights in enumerate(seen.sights):
        frame = next(real, empty if number == 0 or tally.empty == tally.frames else None)
        if frame is None:
            break
        tally.frames += 1
        tally.true += len(frame.things)
        tally.said += len(sights)
        tally.away += abs(len(sights) - len(frame.things))
        pairs = matched(frame.things, sights, lasting)
        tally.right += len(pairs)
        if not frame.things:
            tally.empty += 1
            false_tracks += len({sight.track for sight in sights} - begun)
        begun |= {sight.track for sight in sights}
        for thing in frame.things:
            if isinstance(thing, RealBox) and thing.identity is not None:
                box = thing.box
                paths.setdefault(thing.identity, []).append(((box.left + box.right) / 2, (box.top + box.bottom) / 2))
                sizes[thing.identity] = max(sizes.get(thing.identity, 0.0), box.right - box.left)
        for i, j in pairs:
            name, track = frame.things[i].identity, sights[j].track
            if name is None:
                continue
            tally.switches += lasting.get(name, track) != track
            tally.fragments += name in lasting and name not in found_before
            lasting[name] = track
        found_before = {name for i, _ in pairs if (name := frame.things[i].identity) is not None}
        for thing in frame.things:
            for sight in sights:
                if thing.identity is not None and thing.holds(*sight.place):
                    together[thing.identity, sight.track] += 1
        if frame.moving is not None and frame.counted is not None and number < len(seen.masks):
            said = seen.masks[number].mask() & frame.counted
            pixels += [int((said & frame.moving).sum()), int(said.sum()), int(frame.moving.sum())]
    best = identities(together)
    missed, false = tally.true - tally.right, tally.said - tally.right
    known = not masked and tally.true > 0
    return Score(
        precision=tally.right / max(1, tally.said),
        recall=tally.right / max(1, tally.true),
        f=2 * tally.right / max(1, tally.said + tally.true),
        idf1=2 * sum(together[pair] for pair in best.items()) / max(1, tally.said + tally.true) if known else None,
        mota=1 - (missed + false + tally.switches) / tally.true if known else None,
        switches=tally.switches if known else None,
        fragments=tally.fragments if known else None,
        count_error=tally.away / max(1, tally.frames),
        direction=directions(seen, paths, sizes, best) if known else None,
        mask_f=float(2 * pixels[0] / max(1, pixels[1] + pixels[2])) if pixels[2] and seen.masks else None,
        false_per_minute=false_tracks / (tally.empty / fps / 60) if tally.empty else None,
        ms_per_frame=1000 * seen.seconds / max(1, len(seen.sights)),
    )


def matched(things: list[Real], sights: list[Sight], before: dict[int, int]) -> list[tuple[int, int]]:
    """As many pairs as can be of true objects and sights inside them, those of the frame before preferred."""
    from scipy.optimize import linear_sum_assignment

    if not things or not sights:
        return []
    worth = np.zeros((len(things), len(sights)))
    for i, thing in enumerate(things):
        for j, sight in enumerate(sights):
            if thing.holds(*sight.place):
                kept = thing.identity is not None and before.get(thing.identity) == sight.track
                worth[i, j] = 1 + KEPT * kept
    rows, columns = linear_sum_assignment(-worth)
    return [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if worth[i, j] > 0]


def identities(together: Counter[tuple[int, int]]) -> dict[int, int]:
    """The pairing of true identities and tracks that shares most frames."""
    from scipy.optimize import linear_sum_assignment

    names, tracks = sorted({name for name, _ in together}), sorted({track for _, track in together})
    shared = np.array([[together[name, track] for track in tracks] for name in names]).reshape(len(names), len(tracks))
    rows, columns = linear_sum_assignment(-shared)
    return {names[i]: tracks[j] for i, j in zip(rows, columns, strict=True) if shared[i, j] > 0}


def directions(
    seen: Seen, paths: dict[int, list[tuple[float, float]]], sizes: dict[int, float], best: dict[int, int]
) -> float | None:
    """Share of the true objects that travel whose track has the same main direction; None where none does."""
    said: dict[int, list[tuple[float, float]]] = {}
    for sights in seen.sights:
        for sight in sights:
            said.setdefault(sight.track, []).append(sight.place)
    right = [
        name in best and direction(said[best[name]]) == direction(path)
        for name, path in paths.items()
        if max(abs(path[-1][k] - path[0][k]) for k in (0, 1)) >= TRAVELLED * sizes[name]
    ]
    return float(np.mean(right)) if right else None


def direction(path: list[tuple[float, float]]) -> str:
    """left, right, up or down, from the first place of a path to its last."""
    across, down = path[-1][0] - path[0][0], path[-1][1] - path[0][1]
    if abs(across) >= abs(down):
        return "right" if across > 0 else "left"
    return "down" if down > 0 else "up"
