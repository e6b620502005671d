"""The transitions of the ranging controller as literals."""

import pytest

from ndtorch.navigation import CRUISE, REVERSE, STOPPED, SUPPRESSED, TURN
from ndtorch.navigation.controllers.ranging.modes import Facts, next_mode

NOTHING = Facts(*[False] * 7)


@pytest.mark.parametrize(
    ("mode", "true", "then"),
    [
        (SUPPRESSED, ["learning"], SUPPRESSED),
        (SUPPRESSED, ["learning", "blocked_ahead", "blocked_sides"], SUPPRESSED),
        (SUPPRESSED, [], CRUISE),
        (SUPPRESSED, ["blocked_ahead"], TURN),
        (CRUISE, [], CRUISE),
        (CRUISE, ["blocked_sides", "blocked_rear"], CRUISE),
        (CRUISE, ["blocked_ahead"], TURN),
        (CRUISE, ["blocked_ahead", "blocked_sides"], REVERSE),
        (CRUISE, ["blocked_ahead", "blocked_sides", "blocked_rear"], STOPPED),
        (TURN, ["blocked_ahead"], TURN),
        (TURN, [], TURN),
        (TURN, ["clear"], CRUISE),
        (TURN, ["blocked_ahead", "blocked_sides"], REVERSE),
        (TURN, ["blocked_ahead", "blocked_sides", "blocked_rear"], STOPPED),
        (REVERSE, ["blocked_ahead", "blocked_sides"], REVERSE),
        (REVERSE, ["blocked_ahead", "blocked_sides", "blocked_rear"], REVERSE),
        (REVERSE, ["blocked_ahead", "blocked_sides", "reverse_done"], TURN),
        (REVERSE, ["blocked_ahead", "space_ahead"], TURN),
        (STOPPED, ["blocked_ahead", "blocked_sides", "blocked_rear"], STOPPED),
        (STOPPED, ["blocked_ahead", "blocked_sides"], REVERSE),
        (STOPPED, ["blocked_ahead"], TURN),
    ],
)
def test_transitions(mode, true, then):
    assert next_mode(mode, NOTHING._replace(**dict.fromkeys(true, True))) == then
