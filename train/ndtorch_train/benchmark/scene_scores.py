"""How well the objects that a method finds in scenes of bars agree with the truth, and the rows of the table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from ndtorch_train.benchmark.base import Column
from ndtorch_train.rows import Row

GOOD_F1 = 0.75
"""F1 that every bar of a scene must reach for the scene to be *ok*."""


def feature_f1(found: Tensor, truth: Tensor) -> npt.NDArray[np.float64]:
    """F1 of every bar's features, `[bars]`, with the found objects assigned to the bars as fits best.

    Args:
        found: features of the objects, `[objects, 10]` bool.
        truth: features of the bars, `[bars, 10]` bool.

    A bar that got no object has 0.
    """
    scores = np.zeros(len(truth))
    if len(found) and len(truth):
        both = (truth[:, None] & found).sum(-1).double()
        f1 = (2 * both / (truth.sum(-1)[:, None] + found.sum(-1)).clamp_min(1)).numpy()
        rows, columns = linear_sum_assignment(f1, maximize=True)
        scores[rows] = f1[rows, columns]
    return scores


@dataclass(frozen=True)
class SceneScore:
    """One scene at one moment.

    Attributes:
        bars, found: how many there are, and how many objects the method reports.
        f1: mean F1 of the bars; 1 for a scene with nothing to find in which nothing was found.
        ok: the number is right and every bar's F1 is .75 or more.
    """

    bars: int
    found: int
    f1: float
    ok: bool

    @property
    def counted(self) -> bool:
        """Whether the number of objects is right."""
        return self.bars == self.found


def score_scene(found: Tensor, truth: Tensor) -> SceneScore:
    """Compare objects `[objects, 10]` with bars `[bars, 10]`, both bool."""
    f1 = feature_f1(found, truth)
    counted = len(found) == len(truth)
    mean = float(f1.mean()) if len(truth) else float(counted)
    return SceneScore(len(truth), len(found), mean, counted and bool((f1 >= GOOD_F1).all()))


def share(values: Sequence[bool]) -> tuple[float, float]:
    """Ratio of true values and its binomial standard error."""
    p = float(np.mean(values)) if len(values) else float("nan")
    return p, float(np.sqrt(p * (1 - p) / max(len(values), 1)))


def right_from(times: npt.NDArray[np.float64], counts: npt.NDArray[np.int64], bars: int) -> float:
    """Time from which on the count was right until the end, infinite if it is wrong at the end.

    Args:
        times: of the read-outs, `[n]`.
        counts: objects found at each, `[n]`.
        bars: the right number.
    """
    wrong = np.nonzero(counts != bars)[0]
    if len(wrong) == 0:
        return float(times[0])
    return float(times[wrong[-1] + 1]) if wrong[-1] + 1 < len(times) else math.inf


COLUMNS = (
    Column("set", "set"),
    Column("method", "method"),
    Column("online", "online"),
    Column("seconds", "seconds"),
    Column("scenes", "scenes"),
    Column("count", "count", 3, "count_se", 1),
    *(Column(f"count_{n}", f"{n} bar{'s'[: n - 1]}") for n in (1, 2, 3)),
    Column("f1", "F1", 3, "f1_se", 1),
    Column("ok", "ok", 3, "ok_se", 1),
    Column("alternating", "alternating"),
    Column("right_from", "right from, s"),
)


def scene_row(
    name: str,
    method: str,
    online: bool,
    seconds: float,
    scores: Sequence[SceneScore],
    alternating: float | None = None,
    since: float | None = None,
) -> Row:
    """One method on one set of scenes at one moment.

    Args:
        name: of the set.
        method: its name.
        online: whether it saw the signals only once, in order.
        seconds: after the settling time.
        scores: one a scene.
        alternating: ratio of scenes whose outputs flip sign from step to step.
        since: median seconds from the first frame to the lasting right count, infinite if half never get there.
    """
    f1 = [score.f1 for score in scores]
    (count, count_se), (ok, ok_se) = share([s.counted for s in scores]), share([s.ok for s in scores])
    return {
        "set": name,
        "method": method,
        "online": online,
        "seconds": int(seconds) if seconds == int(seconds) else seconds,
        "scenes": len(scores),
        "count": count,
        "count_se": count_se,
        **{f"count_{n}": share([s.counted for s in scores if s.bars == n])[0] for n in (1, 2, 3)},
        "f1": float(np.mean(f1)),
        "f1_se": float(np.std(f1) / math.sqrt(max(1, len(f1)))),
        "ok": ok,
        "ok_se": ok_se,
        "alternating": alternating,
        "right_from": "never" if since == math.inf else since,
    }
