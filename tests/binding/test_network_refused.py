"""What an inhibitory network does not take."""

from __future__ import annotations

import math

import pytest
import torch

from ndtorch.binding import InhibitoryNetwork
from ndtorch.errors import InputError


def test_the_learning_rate_of_version_0_1_is_told_where_it_went() -> None:
    with pytest.raises(InputError, match=r"gamma is an option of the rule now: rule=learning_rule\("):
        InhibitoryNetwork(10, gamma=torch.tensor([0.5]))  # type: ignore[arg-type]


def test_inputs_of_another_shape_are_refused() -> None:
    with pytest.raises(InputError, match=r"inputs must be \[\.\.\., T, 3\], got \(5, 4\)"):
        InhibitoryNetwork(3)(torch.zeros(5, 4))
    with pytest.raises(InputError, match="at least one time step"):
        InhibitoryNetwork(3)(torch.zeros(0, 3))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"neurons": 1}, "neurons must be a whole number from 2 to 8192, got 1"),
        ({"neurons": 8193}, "from 2 to 8192, got 8193"),
        ({"when_full": "halve"}, "when_full must be 'rescale' or 'stop', got 'halve'"),
        ({"feedback": "none"}, "feedback must be one of delayed, settled, got 'none'"),
        ({"rule": "oja"}, "rule must be one of competitive, .*, got 'oja'"),
        ({"every": 0.05}, "with delayed feedback the weights change at every step of 0.01 s, got every=0.05"),
        ({"initial": torch.zeros(3, 2)}, r"initial weights must be \[3, 3\], got \(3, 2\)"),
        ({"tau_in": -1.0}, "tau"),
        ({"tau_out": math.nan}, "tau"),
        ({"tau_mean": -1.0}, "tau"),
        ({"dt": 0.0}, "dt must"),
    ],
)
def test_options_out_of_range_are_refused(options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        InhibitoryNetwork(**{"neurons": 3, **options})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("settle", math.nan),
        ("faint", -1.0),
        ("every", math.inf),
        ("window", math.nan),
        ("initial", -torch.ones(3, 3)),
        ("initial", torch.ones(3, 3)),
    ],
)
def test_options_that_would_do_nothing_or_harm_are_refused(name: str, value: object) -> None:
    with pytest.raises(InputError, match=name):
        InhibitoryNetwork(3, **{name: value})
