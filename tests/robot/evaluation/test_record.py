"""What is kept of a drive."""

import numpy as np
import pytest

from ndtorch_robot.evaluation.record import Record


@pytest.mark.parametrize(
    ("commands", "turns"),
    [
        ([(0.5, 0), (0.5, 1), (0.4, 2), (0.5, 0), (0.5, 1)], 2),  # a turn that gets tighter is one
        ([(0.5, 1), (0.5, -1)], 2),
        ([(0.5, 0), (-0.3, 1.9), (-0.3, 1.6), (-0.3, 1.3), (0.5, 0)], 0),  # back on the way it came
        ([], 0),
    ],
)
def test_turns_are_counted_when_they_begin(commands, turns):
    made = object.__new__(Record)
    made.command = [np.array(pair) for pair in commands]
    assert made.turns == turns
