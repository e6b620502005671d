"""Superposed sums against rendered scenes."""

from __future__ import annotations

import torch

from ndtorch.scenes import three_bars
from ndtorch.vision import GROUPS
from ndtorch_train.superposed import Bars, Stimuli
from tests.films import sums_of


def test_superposed_sums_are_those_of_the_rendered_scene(bars: Bars) -> None:
    """At a phase and offset that were never filmed; after the filters have settled."""
    want = sums_of(three_bars(3.6, phase=77.0, blue_offset=33.0))[300:]
    stimuli = Stimuli(bars)
    got = stimuli.red(3.6) + stimuli.green([77.0], 3.6)[0] + stimuli.blue([33.0], 3.6)[0]
    error = (got[300:] - want).abs().amax(0) / want.amax()
    by_feature = (got[300:] - want).abs().amax(0) / want.amax(0)
    assert by_feature[[0, 1, 2]].max() < 0.015  # motion to the left, right and down
    assert error[3] < 1e-3  # nothing moves up
    assert by_feature[GROUPS["orientation"]].max() < 0.08  # orientation: filters of bars overlap
    assert by_feature[GROUPS["color"]].max() < 0.002


def test_films_repeat_with_the_period_of_the_shadow(bars: Bars) -> None:
    sums = bars.red.at(torch.tensor([10.0, 60.0]), 2.0)
    torch.testing.assert_close(sums[0], sums[1], rtol=1e-4, atol=1e-3)
    later = bars.blue.at(torch.tensor(0.0), 3.0)
    torch.testing.assert_close(later[:100], later[100:200], rtol=1e-3, atol=1e-2)
