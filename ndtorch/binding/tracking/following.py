"""Figures over time: regions that stand out are given to the tracks that expected them; groups merge and split."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from ndtorch.binding.tracking.far_away import tiny
from ndtorch.binding.tracking.figure_params import FigureParams
from ndtorch.binding.tracking.figures import FOLLOWED, PATCH, PIXELS, SIGHTING, Figure, Numbers
from ndtorch.binding.tracking.many import one_of_many
from ndtorch.binding.tracking.meeting import apart, meeting, visible
from ndtorch.binding.tracking.parting import parting
from ndtorch.binding.tracking.regions import Floats, Labels, Regions, shares
from ndtorch.binding.tracking.restless import restless
from ndtorch.binding.tracking.shades import Light
from ndtorch.binding.tracking.silhouettes import Sighting, share, sightings, told
from ndtorch.binding.tracking.whole import clear, look_again, moves_as_a_whole, straightness, swings, taken_back
from ndtorch.vision.camera.figures import Standing

EDGE = 0.003
"""What is nearer to the edge of the picture than this share of its height touches it."""


def follow(
    figures: list[Figure],
    time: float,
    seen_for: float,
    regions: Regions,
    standing: Standing,
    light: Light,
    gone: Floats,
    come: Numbers,
    began: int,
    dt: float,
    p: FigureParams,
) -> tuple[list[Figure], list[Figure], Labels]:
    """One step: every track to the region that fills most of its expected box, those left over by distance and color.

    A region that is that of several known tracks is shared: each of its pixels goes to the track whose box is nearest,
    in sizes of that box, and whose color is most alike. When they part, place, color and size say who is who. Other
    regions inside a track's expected box are pieces of it. What is left begins a track.

    Args:
        figures: open tracks; those that are seen are changed.
        time: seconds.
        seen_for: seconds since the scene began.
        regions: of this step.
        standing: picture, ground and noise of this step.
        light: in which it was taken.
        gone: how many tracks came and went at each place, of `come_and_gone`.
        come: tracks that came lately, of `comings`.
        began: tracks begun so far.
        dt: seconds of a step.
        p: constants.

    Returns:
        the open tracks, those that were out of sight for too long, and the silhouettes: the number of the track of
        every pixel plus one, 0 where none is, `[h, w]`.
    """
    labels, height, picture = regions.labels, regions.labels.shape[0], standing.picture
    width = labels.shape[1] / height
    late, kept = list[Figure](), list[Figure]()
    for one in figures:
        (late if time - one.last_seen > patience(one, dt, p) else kept).append(one)
    count = len(regions.areas)
    given, pieces = meeting(kept, time, regions, p)
    parting(kept, given, pieces, regions, picture, time, p)
    taken = {k for ks in given.values() for k in ks}
    for k, r in apart(kept, taken, {r: given[r] for r in given if r not in pieces}, regions, picture, time, p):
        given[r].append(k)
    owners = np.zeros(count + 1, np.int32)
    groups: list[tuple[int, list[Figure]]] = []
    absorbed: set[int] = set()
    for r in range(count):
        ones, hidden, parts = visible([kept[k] for k in given[r]], regions.areas[r] / height**2, p)
        absorbed |= {one.number for one in parts}
        # Of one that hides others it is not seen by itself what it looks like.
        if len(ones) > 1 or hidden:
            groups.append((r, ones))
        elif ones:
            owners[r + 1] = ones[0].number + 1
        elif r in pieces:
            owners[r + 1] = kept[pieces[r]].number + 1
        else:
            began += 1
            owners[r + 1] = began
            box = regions.boxes[r]
            kept.append(start(began - 1, time, np.array([box[0] + box[2], box[1] + box[3]]) / 2 / height))
    silhouettes: Labels = told(labels, owners)
    for r, ones in groups:
        share(silhouettes, labels, r, regions.boxes[r], ones, time, picture, p)
    every = sightings(kept, silhouettes, standing, light, {one.number for _, ones in groups for one in ones})
    shaded = np.zeros(0) if all(one.known for one in kept) else shares(silhouettes, standing.narrow, began)
    for one, seen in zip(kept, every, strict=True):
        if seen is not None:
            if not one.known and seen.pixels >= p.smallest * width and begun(one) and tiny(one, width, p):
                # All before was a piece of it.
                vars(one).update(vars(start(one.number, time, np.array(seen.place))))
            add(one, time, seen, width, p)
            if not one.known and not seen.shared:
                one.sure += seen.sure
                one.narrow += shaded[one.number + 1]
                look_again(one, picture, standing.ground, p)
    stirred, lit = bool(gone.any()), cache(standing.ground.mean)
    for one in kept:
        if (
            seen_for > p.warm_up - dt / 2
            and not one.known
            and one.last_seen == time
            and travels(one, gone, dt, p)
            and (not tiny(one, width, p) or certain(one, p))
            and not is_shadow(one, p)
            and is_thing(one, lit, p)
            and not part_of_another(one, kept, p)
            and not one_of_many(one, come, seen_for, width, p)
        ):
            one.known, one.since = True, time if one.since < 0 else one.since
        elif one.known and one.last_seen == time:
            one.known = not taken_back(one, bool(stirred and restless(one, gone)), time, dt, p)
    for one in (*kept, *late):
        # It may be that the others came later.
        if one.known and one.last_seen - one.since < p.trial and one_of_many(one, come, seen_for, width, p):
            one.known = False
    return [one for one in kept if one.number not in absorbed], late, silhouettes


def patience(one: Figure, dt: float, p: FigureParams) -> float:
    """How long a track out of sight is waited for: one that is no object yet for no longer than it was in sight, and
    every one until the next picture, `dt` later, may show it."""
    wanted = p.coast if one.known else min(p.coast, max(p.shortest, one.last_seen - one.first_seen))
    return max(wanted, 1.5 * dt)


def travels(one: Figure, gone: Floats, dt: float, p: FigureParams) -> bool:
    """Whether a track has been in sight for long enough, and for most of that time, and has gone far enough.

    Where others came and went it has to go further.
    """
    far = math.dist(one.last[FOLLOWED], one.start)
    span = one.last_seen - one.first_seen
    seen = (len(one.before) + len(one.late)) * dt
    # Small pieces of noise, leaves and a codec's blocks wander by more than their own size.
    enough = max(p.travel * one.size, p.way) if p.travel else 0.0
    if far < enough or span < p.shortest or seen < p.steady * (span + dt):
        return False
    unrest = min(1.0, restless(one, gone) / p.restless)
    further = enough if unrest < 1 else p.wander * enough
    return far >= further and (not unrest or straightness(one, p) >= p.straight * unrest)


def is_thing(one: Figure, light: Callable[[], float], p: FigureParams) -> bool:
    """Whether a track stands out clearly from the ground and does not swing, or moves as a whole and straight; anything
    is, where `travel` is 0. What was taken back has to go straight, too. `light` gives the mean of the ground: it is
    seldom asked for, and the same for all tracks."""
    if not p.travel or (clear(one, p) and one.since < 0 and not swings(one, p)):
        return True
    return (clear(one, p) or moves_as_a_whole(one, float(light()), p)) and straightness(one, p) >= p.straight


def begun(one: Figure) -> bool:
    """Whether a track has sightings."""
    return bool(one.late) or len(one.before) > 0


def certain(one: Figure, p: FigureParams) -> bool:
    """Whether a tiny track stands out clearly, and went far and straight."""
    enough = p.certain * max(p.travel * one.size, p.way) if p.travel else 0.0
    return clear(one, p) and straightness(one, p) >= p.unbent and math.dist(one.last[FOLLOWED], one.start) >= enough


def is_shadow(one: Figure, p: FigureParams) -> bool:
    """Whether a track was, in all its sightings together, hardly more than a narrow shadow."""
    return one.narrow >= p.shadow * (len(one.before) + len(one.late))


def part_of_another(one: Figure, others: Sequence[Figure], p: FigureParams) -> bool:
    """Whether a much larger track beside it moves as it does: common fate. So do shadows, and pieces of a thing."""
    time, top, left, bottom, right = one.last[0], *one.last[3:7]
    speed = math.hypot(*one.velocity)
    for other in others:
        if other is one or other.last_seen != time or other.last[PIXELS] < p.larger * one.last[PIXELS]:
            continue
        box = other.last[3:7]
        gap = max(top - box[2], box[0] - bottom, left - box[3], box[1] - right)
        if gap >= p.beside * other.size:
            continue
        if math.dist(one.velocity, other.velocity) < p.fate * max(speed, math.hypot(*other.velocity)):
            return True
    return False


def start(number: int, time: float, place: Numbers) -> Figure:
    """A track without sightings."""
    two, ten = np.zeros(2), np.zeros(10)
    none, blank = np.zeros((0, SIGHTING)), np.zeros((3, PATCH, PATCH), np.float32)
    looks = (np.zeros(4), blank, two, 0.0, 0.0, -1.0)
    return Figure(number, False, two, two, np.zeros(3), place, time, place, ten, ten, np.zeros(4), *looks, none)


def add(one: Figure, time: float, seen: Sighting, across: float, p: FigureParams) -> None:
    """Take a sighting in a picture so many heights across. In a shared region the size is remembered, not seen.

    To grow is not to travel: what is no object yet and is much larger at once, as a screen after a cut, begins its way
    anew. What touches the edge of the picture may be coming in.
    """
    (row, column), (tall, wide), pixels = seen.place, seen.extent, seen.pixels
    one.shades = one.shades + seen.shades
    if begun(one):
        gap = time - one.last_seen
        # Plain numbers: arrays of two take several times as long.
        there, down, (height, width) = one.expected(time, p.ahead), one.velocity.tolist(), one.extent.tolist()
        if seen.shared:
            share_of, pixels = p.follow * p.grouped, one.last[PIXELS]
            row, column = there[0] + share_of * (row - there[0]), there[1] + share_of * (column - there[1])
            tall, wide = height, width
        else:
            if not one.known and pixels > p.alike_size * one.last[PIXELS]:
                room = min(row - tall / 2, column - wide / 2, 1 - row - tall / 2, across - column - wide / 2)
                one.start = one.start if room < EDGE else np.array((row, column))
            keep = gap / (p.tau_size + gap)
            one.extent = np.array((height + keep * (tall - height), width + keep * (wide - width)))
            one.color = one.color + keep * (seen.color - one.color)
        # Of a young track the mean of all steps so far.
        pace, span = max(gap / (p.tau_velocity + gap), 1 / (len(one.before) + len(one.late))), max(gap, 1e-9)
        residual = row - there[0], column - there[1]
        one.velocity = np.array([own + pace * by / span for own, by in zip(down, residual, strict=True)])
    else:
        one.extent, one.color = np.array((tall, wide)), seen.color
    if math.dist((row, column), one.rest) > p.moves * one.size:
        one.moved, one.rest = time, np.array((row, column))
    box = row - tall / 2, column - wide / 2, row + tall / 2, column + wide / 2
    one.late.append((time, *seen.inner, *box, pixels, row, column))
