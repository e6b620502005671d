"""Read-out of single objects from the covariances of what is seen of them."""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.binding.learning import settled
from ndtorch.binding.readout.covariances import columns, single_table
from ndtorch.vision import FEATURES, GROUPS

NONE = torch.zeros(10, 10)


def seen(**features: float) -> Tensor:
    """Covariances of signals that all go with one light."""
    strength = torch.zeros(10)
    for name, value in features.items():
        strength[FEATURES.index(name)] = value
    return strength[:, None] * strength


def test_the_strongest_owns_and_its_column_is_what_fluctuates_with_it() -> None:
    # Motion is in other units, and counts by its own largest.
    covariances = seen(right=500.0, down=300.0, red=2.0, green=0.2)
    owner, column = columns(covariances, NONE)
    assert FEATURES[int(owner)] == "right"
    table = single_table(covariances, torch.tensor(True), NONE)
    assert table.owners.nonzero().tolist() == [[FEATURES.index("right")]]
    features = {name: round(v, 3) for name, v in zip(FEATURES, table.rows[owner].tolist(), strict=True) if v > 0}
    assert features == {"right": 1.0, "down": 0.6, "red": 1.0}
    assert single_table(covariances, torch.tensor(True), NONE, 0.05).rows[owner, FEATURES.index("green")] > 0
    assert column[FEATURES.index("down")] < column[owner]


def test_the_first_stage_is_taken_into_account() -> None:
    first = torch.zeros(10, 10)
    first[GROUPS["color"], GROUPS["color"]] = 0.4 - 0.4 * torch.eye(3)
    covariances = seen(right=1.0, red=1.0, green=0.9)
    gain = settled(first)
    owner, column = columns(covariances, first)
    expected = (gain @ covariances @ gain.mT)[:, int(owner)]
    assert torch.allclose(column, expected, atol=1e-6)


def test_a_group_of_its_own_way_speaks_for_itself_before_a_light_ground() -> None:
    # Color goes one way; motion and orientation the other, as the thing gets darker than what is behind it.
    strength, against = torch.zeros(10), torch.zeros(10)
    strength[FEATURES.index("red")], strength[FEATURES.index("green")] = 2.0, 0.2
    against[FEATURES.index("right")], against[FEATURES.index("60°")] = 1.0, 0.5
    mixed = strength - 0.8 * against
    covariances = mixed[:, None] * mixed + 0.01 * against[:, None] * against
    there = torch.tensor(True)
    dark, light = (single_table(covariances, there, NONE, apart=torch.tensor(apart)) for apart in (False, True))
    found = [{name for name, v in zip(FEATURES, t.rows.sum(-2).tolist(), strict=True) if v > 0} for t in (dark, light)]
    assert found[0] < found[1] == {"red", "right", "60°"}
    assert torch.equal(single_table(covariances, there, NONE).rows, dark.rows)
