"""Which tracks are of one object: side by side, or one after the other behind something."""

from __future__ import annotations

import numpy as np
import pytest

from ndtorch.binding.tracking.params import TrackParams
from ndtorch.binding.tracking.tracks import Track, begun, is_same

C = TrackParams()
ASPECT, DT = 2.0, 0.04


def track(
    first: float, steps: int, row: float, column: float, turned: float = 0.0, hue: float = 0.0, pace: float = 0.5
) -> Track:
    """Of a thing that goes to the right, or `turned` from there, `pace` heights a second; its color by an angle."""
    made = begun(0)
    time = (first + DT * np.arange(steps)).round(6)
    gone = pace * (time - first)
    made.before = np.stack(
        [time, row + gone * np.sin(turned), column + gone * np.cos(turned) / ASPECT, np.ones(steps)], 1
    )
    made.outputs = np.zeros(14)
    made.outputs[7], made.outputs[8] = np.cos(hue), np.sin(hue)
    return made


def same(one: Track, other: Track) -> bool:
    forth, back = (is_same(*pair, ASPECT, C) for pair in ((one, other), (other, one)))
    assert forth == back
    return forth


@pytest.mark.parametrize("share", [0.95, 1.05])
def test_parts_side_by_side_are_near_and_alike_and_go_the_same_way(share: float) -> None:
    one = track(0.0, 50, 0.5, 0.2)
    assert same(one, track(0.0, 50, 0.5 + share * C.beside, 0.2)) == (share < 1)
    assert same(one, track(0.0, 50, 0.5, 0.2 + share * C.beside / ASPECT)) == (share < 1)
    assert same(one, track(0.0, 50, 0.55, 0.2, hue=share * np.arccos(C.alike))) == (share < 1)
    slow = track(0.0, 50, 0.5, 0.2, pace=0.1)
    assert same(slow, track(0.0, 50, 0.5, 0.2, turned=share * np.arccos(C.along), pace=0.1)) == (share < 1)


@pytest.mark.parametrize("share", [0.95, 1.05])
def test_what_was_hidden_comes_out_soon_where_it_was_heading(share: float) -> None:
    one, end = track(0.0, 50, 0.5, 0.1), 0.1 + 0.5 * 49 * DT / ASPECT
    # The ends of a path are means of places, so the pace that is taken over is a little lower than that of the thing.
    pace = 0.5 * (1 - C.ends)
    after = track(49 * DT + share * C.behind, 50, 0.5, end + pace * C.behind / ASPECT)
    assert same(one, after) == (share < 1)
    gap, there = 1.0, end + pace * 1.0 / ASPECT
    for away in ((share * C.comes_back, 0.0), (-share * C.comes_back, 0.0), (0.0, share * C.comes_back / ASPECT)):
        assert same(one, track(49 * DT + gap, 50, 0.5 + away[0], there + away[1])) == (share < 1), away


def test_few_common_times_are_no_company() -> None:
    """Where two were seen together for a moment, one goes on as the other."""
    one = track(0.0, 50, 0.5, 0.1)
    end = 0.1 + 0.5 * 49 * DT / ASPECT
    steps = round(C.together * 50)
    apart = 0.5 + 1.2 * C.beside
    assert C.beside * 1.2 < C.comes_back
    assert same(one, track(49 * DT - (steps - 2) * DT, 50, apart, end - 0.5 * (steps - 2) * DT / ASPECT))
    assert not same(one, track(49 * DT - (steps + 2) * DT, 50, apart, end - 0.5 * (steps + 2) * DT / ASPECT))
