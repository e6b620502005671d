"""Fits that would move much of the building wait until a second one, of another part, says the same.

A single wrong fit between a room and what lies outside would take the whole room with it, since all parts of the room
hold to each other. What a fit would move, and whether the place of that was certain, is told by the covariances of the
graph, as in a Kalman filter that takes the fit as a measurement.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch

from ndtorch.navigation.localisation.graph import Links, covariance_of, links_of, seen_from, slopes, wrapped
from ndtorch.navigation.localisation.params import LocaliserParams, PartParams
from ndtorch.navigation.localisation.parts import Parts, links_between, relaxed
from ndtorch.navigation.localisation.walls import Floats


class Known(NamedTuple):
    """The graph as it is known so far: poses `[K, 3]` and their covariance `[3 K, 3 K]`."""

    poses: Floats
    covariance: Floats


class Surprise(NamedTuple):
    """A fit beside what is known: how far off it is `[3]`, with what covariance `[3, 3]`, and that of all poses with
    it `[3 K, 3]`."""

    off: Floats
    spread: Floats
    cross: Floats

    @property
    def far(self) -> float:
        """Squared distance in standard deviations."""
        return float(self.off @ np.linalg.solve(self.spread, self.off))


def surprise(known: Known, fits: Links, n: int) -> Surprise:
    """The n-th fit beside what is known."""
    first, second = int(fits.first[n]), int(fits.second[n])
    off = fits.measure[n] - seen_from(known.poses[first], known.poses[second])
    off[2] = wrapped(off[2])
    to_a, to_b = (slope[0] for slope in slopes(known.poses[first, None], known.poses[second, None]))
    a, b = slice(3 * first, 3 * first + 3), slice(3 * second, 3 * second + 3)
    cross = known.covariance[:, a] @ to_a.T + known.covariance[:, b] @ to_b.T
    return Surprise(off, to_a @ cross[a] + to_b @ cross[b] + np.linalg.inv(fits.information[n]), cross)


def learned(known: Known, fits: Links, n: int) -> Known:
    """What is known with the n-th fit."""
    one = surprise(known, fits, n)
    gain = np.linalg.solve(one.spread, one.cross.T).T
    return Known(known.poses + (gain @ one.off).reshape(-1, 3), known.covariance - gain @ one.cross.T)


def moves_much(known: Known, one: Surprise, newest: int, p: PartParams) -> bool:
    """Whether a fit would move many of the parts before the newest by more than they may be wrong."""
    part = np.arange(1, max(newest, 1))
    step = (one.cross @ np.linalg.solve(one.spread, one.off)).reshape(-1, 3)[part, :2]
    own = known.covariance.reshape(len(known.poses), 3, -1, 3)[part, :2, part, :2] + 1e-6 * np.eye(2)
    far = np.einsum("ni,nij,nj->n", step, np.linalg.inv(own), step)
    return int(((far > p.moved) & (np.hypot(*step.T) > p.by)).sum()) >= p.many


def settled(parts: Parts, odometer: Floats, doubt: Floats, params: LocaliserParams) -> Parts:
    """The parts moved to where they fit each other, by the fits that count.

    Args:
        odometer, doubt: what is known of scale, bend and drift, and standard deviations, `[3]` each.
    """
    return relaxed(agreed(parts, odometer, doubt, params), odometer, doubt, params)


def agreed(parts: Parts, odometer: Floats, doubt: Floats, params: LocaliserParams) -> Parts:
    """The fits of the newest part, and those that waited, sorted into what counts and what waits; see `settled`."""
    p, newest = params.parts, len(parts.done) - 1
    new = parts.edges[:, 1] == newest
    tried = torch.cat((parts.waiting, parts.edges[new]))
    if not len(tried):
        return parts
    parts = parts._replace(edges=parts.edges[~new])
    poses, links, fits = parts.poses.numpy(), links_between(parts, odometer, params), links_of(tried.numpy())
    known = Known(poses, covariance_of(poses, links, p.gate, doubt))
    left, count = list(range(len(tried))), []
    while left:
        beside = {n: surprise(known, fits, n) for n in left}
        # The least surprising first: what it tells may make the others less so.
        left.sort(key=lambda n: beside[n].far)
        good = next(([n] for n in left if not moves_much(known, beside[n], newest, p)), None)
        good = confirmed(known, fits, left, newest, p) if good is None else good
        for n in good:
            known = learned(known, fits, n)
            left.remove(n)
        if not good:
            break
        count += good
    left = [n for n in left if newest - int(fits.second[n]) < p.patience]
    return parts._replace(edges=torch.cat((parts.edges, tried[count])), waiting=tried[left])


def confirmed(known: Known, fits: Links, left: list[int], newest: int, p: PartParams) -> list[int]:
    """A fit of the newest part and one of another part after which it moves little more; empty where there are none."""
    for n in (n for n in left if fits.second[n] == newest):
        with_it = learned(known, fits, n)
        for m in (m for m in left if fits.second[m] != newest):
            one = surprise(with_it, fits, m)
            if one.far < p.same and not moves_much(with_it, one, newest, p):
                return [n, m]
    return []
