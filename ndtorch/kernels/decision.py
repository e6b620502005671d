"""What the ranging controller drives next, of one car, in plain numbers."""

from __future__ import annotations

from typing import NamedTuple


class Machine(NamedTuple):
    """State of the machine: the numbers of `RangingState` after its floor and patch."""

    mode: float
    age: float
    side: float
    swing: float
    gone: float
    bold: float
    difference: float


class Tables(NamedTuple):
    """`Constants` of the controller as plain numbers and lists, under the same names."""

    comparison: list[list[float]]
    table: list[int]
    speeds: list[float]
    bends: list[float]
    turn_at: float
    go_at: float
    wide_needs: float
    least: float
    turn_steps: float
    reverse_length: float
    reversed: float
    rear: float
    room: float
    prefer: float
    grace: float
    swing: float
    metres: float
    facts: int
    reverse: int
    turn: int
    cruise: int


def decision(
    lengths: list[list[float]], speed: float, ages: tuple[float, float, float], state: Machine, tables: Tables
) -> tuple[float, float, Machine]:
    """`decide`: speed, curvature and the new state.

    Args:
        lengths: of the arcs, first to what blocks them and then to what is not known.
        speed: what the car drove since the last frame.
        ages: of the floor's state, until when the car stands, and until when it learns.
    """
    c, (free, known), (age_of_floor, standing, learning) = tables, lengths, ages
    difference = sum(
        w * x for row, far in zip(c.comparison, lengths, strict=True) for w, x in zip(row, far, strict=False)
    )
    reversing = state.mode == c.reverse
    bound = reversing or state.mode == c.turn or abs(difference) < c.prefer
    side = state.side if bound else float((difference > 0) - (difference < 0))
    first = 1 if side > 0 else 3
    confined = [min(a, b + c.grace) for a, b in zip(free, known, strict=True)]
    wide, tight = confined[first], confined[first + 1]
    longest = max(wide, tight)
    blocked = max(free[first], free[first + 1]) < c.least
    swing_back = confined[5] if side > 0 else confined[7]
    swing = state.swing if reversing else float(swing_back > c.swing)
    rear = swing_back if swing > 0 else (free[6] if blocked else confined[6])
    unseen = longest < c.least and rear >= c.swing and state.bold < 1
    gone = state.gone - speed * c.metres if reversing else 0.0
    age = state.age + 1
    facts = (
        age_of_floor < learning,
        free[0] < c.turn_at,
        free[0] >= c.go_at and age >= c.turn_steps,
        blocked or unseen,
        gone >= c.reverse_length or rear < c.rear,
        gone >= c.reversed and longest >= c.room,
        rear < c.rear,
    )
    code = sum(1 << n for n, fact in enumerate(facts) if fact)
    mode = c.table[code + int(state.mode) * c.facts]
    row = mode * 4 + (wide >= c.wide_needs) * 2 + int(swing)
    ahead = 0.0 if age_of_floor <= standing else c.speeds[row]
    bold = 1.0 if mode == c.reverse else 0.0 if mode == c.cruise else state.bold
    after = Machine(mode, age if mode == state.mode else 0.0, side, swing, gone, bold, difference)
    return ahead, c.bends[row] * side, after
