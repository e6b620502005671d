"""The transitions of the ranging controller as literals, and the table that holds them."""

import itertools

import pytest

from ndtorch.navigation import CRUISE, REVERSE, STOPPED, SUPPRESSED, TURN
from ndtorch.navigation.controllers.ranging.modes import Facts, next_mode, transition_table

NOTHING = Facts(*[False] * 7)


@pytest.mark.parametrize(
    ("mode", "true", "then"),
    [
        (SUPPRESSED, ["learning"], SUPPRESSED),
        (SUPPRESSED, ["learning", "near", "hemmed"], SUPPRESSED),
        (SUPPRESSED, [], CRUISE),
        (SUPPRESSED, ["near"], TURN),
        (CRUISE, [], CRUISE),
        (CRUISE, ["hemmed", "cornered"], CRUISE),
        (CRUISE, ["near"], TURN),
        (CRUISE, ["near", "hemmed"], REVERSE),
        (CRUISE, ["near", "hemmed", "cornered"], STOPPED),
        (TURN, ["near"], TURN),
        (TURN, [], TURN),
        (TURN, ["clear"], CRUISE),
        (TURN, ["near", "hemmed"], REVERSE),
        (TURN, ["near", "hemmed", "cornered"], STOPPED),
        (REVERSE, ["near", "hemmed"], REVERSE),
        (REVERSE, ["near", "hemmed", "cornered"], REVERSE),
        (REVERSE, ["near", "hemmed", "backed"], TURN),
        (REVERSE, ["near", "room"], TURN),
        (STOPPED, ["near", "hemmed", "cornered"], STOPPED),
        (STOPPED, ["near", "hemmed"], REVERSE),
        (STOPPED, ["near"], TURN),
    ],
)
def test_transitions(mode, true, then):
    assert next_mode(mode, NOTHING._replace(**dict.fromkeys(true, True))) == then


def test_the_table_holds_the_function():
    table = transition_table()
    assert len(table) == 5 * 2**7
    for mode, values in itertools.product(range(5), itertools.product((0, 1), repeat=7)):
        number = mode * 128 + sum(value << k for k, value in enumerate(values))
        assert int(table[number]) == next_mode(mode, Facts(*map(bool, values)))
