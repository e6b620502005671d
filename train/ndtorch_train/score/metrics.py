"""How good the objects found in a scene are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment
from torch import Tensor

GOOD_F1 = 0.75
"""F1 that every bar of a scene must reach for the scene to be *ok*."""


def feature_f1(found: Tensor, truth: Tensor) -> npt.NDArray[np.float64]:
    """F1 of every bar's features, `[bars]`, with the found objects given to the bars as fits best.

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
        bars, found: how many there are, and how many objects the method claims.
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


def share(values: list[bool] | npt.NDArray[np.bool_]) -> tuple[float, float]:
    """Share of true values and its standard error over scenes (binomial)."""
    p = float(np.mean(values)) if len(values) else float("nan")
    return p, float(np.sqrt(p * (1 - p) / max(len(values), 1)))


def right_from(times: npt.NDArray[np.float64], counts: npt.NDArray[np.int64], bars: int) -> float:
    """Time from which on the count was right until the end, NaN if it is wrong at the end.

    Args:
        times: of the read-outs, `[n]`.
        counts: objects found at each, `[n]`.
        bars: the right number.
    """
    wrong = np.nonzero(counts != bars)[0]
    if len(wrong) == 0:
        return float(times[0])
    return float(times[wrong[-1] + 1]) if wrong[-1] + 1 < len(times) else float("nan")
