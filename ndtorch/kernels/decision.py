"""What the ranging controller drives next, of one car, in plain numbers."""

from __future__ import annotations

from typing import Any

Array = Any
Machine = tuple[float, float, float, float, float, float, float]
"""Mode, age, side, swing, metres gone back, bold, difference: `RangingState` after its floor and patch."""

NUMBERS: tuple[str, ...] = ("turn_at", "go_at", "wide_needs", "least", "turn_steps", "reverse_length", "reversed")
NUMBERS += ("rear", "room", "prefer", "grace", "swing", "wide_swing", "metres", "facts", "reverse", "turn", "cruise")
NUMBERS += ("tightest",)
"""Which of the controller's `Constants` make `numbers`, in order."""


def decision(
    lengths: Array,
    speed: float,
    trail: tuple[float, float],
    ages: tuple[float, float, float],
    state: Machine,
    comparison: Array,
    table: Array,
    moves: Array,
    numbers: tuple[float, ...],
) -> tuple[float, float, Machine]:
    """`decide`: speed, curvature and the new state.

    Args:
        lengths: of the arcs, first to what blocks them and then to what is not known, `[2, arcs]`.
        speed: what the car drove since the last frame.
        trail: how far it leads back, and the curvature that follows it.
        ages: of the floor's state, until when the car stands, and until when it learns.
        state: before.
        comparison: weights of the first arcs, `[2, 5]`.
        table: of transitions.
        moves: speed and curvature of every mode, `[2, 4 modes]`.
        numbers: see `NUMBERS`.
    """
    turn_at, go_at, wide_needs, least, turn_steps, reverse_length, backed, nothing, room, prefer = numbers[:10]
    grace, enough, plenty, metres, facts, reverse, turn, cruise = numbers[10:18]
    age_of_floor, standing, learning = ages
    mode, age, side, swing, gone, bold, _ = state
    free, known = lengths
    difference = 0.0
    for row in range(2):
        for k in range(comparison.shape[1]):
            difference += comparison[row, k] * lengths[row, k]
    reversing = mode == reverse
    if not (reversing or mode == turn or abs(difference) < prefer):
        side = 1.0 if difference > 0 else -1.0 if difference < 0 else 0.0
    first = 1 if side > 0 else 3
    wide, tight = min(free[first], known[first] + grace), min(free[first + 1], known[first + 1] + grace)
    longest = max(wide, tight)
    blocked = max(free[first], free[first + 1]) < least
    behind = 5 if side > 0 else 7
    swing_back = min(free[behind], known[behind] + grace)
    if not reversing:
        swing = 1.0 if swing_back > enough and (trail[0] < nothing or swing_back > plenty) else 0.0
    tracked = trail[0] >= nothing and swing <= 0
    straight_back = free[6] if blocked else min(free[6], known[6] + grace)
    rear = trail[0] if tracked else swing_back if swing > 0 else straight_back
    unseen = longest < least and rear >= enough and bold < 1
    gone = gone - speed * metres if reversing else 0.0
    age += 1
    code = 1 * (age_of_floor < learning) + 2 * (free[0] < turn_at) + 4 * (free[0] >= go_at and age >= turn_steps)
    code += 8 * (blocked or unseen) + 16 * ((gone >= reverse_length and not tracked) or rear < nothing)
    code += 32 * (gone >= backed and longest >= room) + 64 * (rear < nothing)
    after = float(table[code + int(mode) * int(facts)])
    row = int(after) * 4 + 2 * (wide >= wide_needs) + int(swing)
    ahead = 0.0 if age_of_floor <= standing else moves[0, row]
    if after == reverse:
        bold = 1.0
    elif after == cruise:
        bold = 0.0
    bend = trail[1] if tracked and after == reverse else moves[1, row] * side
    return ahead, bend, (after, age if after == mode else 0.0, side, swing, gone, bold, difference)
