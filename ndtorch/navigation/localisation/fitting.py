"""Parts of the building fitted to each other, from where the graph has them and no farther off than it may be wrong.

Along a bare wall a part fits anywhere. A fit that may begin and end anywhere slides along, and turns the parts that
hang on it; the graph knows better where the two are, mostly to some centimetres.
"""

from __future__ import annotations

import math

import numpy as np
import torch

from ndtorch.navigation.localisation.graph import seen_from, wrapped
from ndtorch.navigation.localisation.params import LocaliserParams, PartParams
from ndtorch.navigation.localisation.parts import Parts
from ndtorch.navigation.localisation.walls import Fit, Floats, Scan, fit_scan, unpack


def fit_pair(parts: Parts, params: LocaliserParams) -> Parts:
    """Fit the next pair of parts that is left."""
    p, pair = params.parts, parts.pairs[0].numpy()
    first, second, sure = int(pair[0]), int(pair[1]), pair[2:].reshape(3, 3)
    poses = parts.poses.numpy()
    start = seen_from(poses[first], poses[second])
    # Points, not the middles of cells: these are a cell apart along any wall, and would lock into each other.
    scan = Scan(*np.ascontiguousarray(parts.done[second].points.numpy().T))
    known = unpack(parts.done[first].packed, params, p.size)
    x, y, heading = start.tolist()
    place = min(p.loose, p.reach * math.sqrt(np.linalg.eigvalsh(sure[:2, :2])[1]))
    turn = min(p.turned, p.reach * math.sqrt(sure[2, 2]))
    beside = [(x + i * place, y + j * place, heading) for i in (0, -1, 1) for j in (0, -1, 1)]
    fits = [fit_scan(known, scan, at, (place, turn), params, p.steps) for at in beside]
    fits = [one for one in fits if likely(one, start, sure, p)]
    parts = parts._replace(pairs=parts.pairs[1:])
    if not fits:
        return parts
    fit = max(fits, key=lambda one: one.score)
    elsewhere = [one.score for one in fits if math.hypot(one.x - fit.x, one.y - fit.y) > p.apart]
    if fit.score < p.good or fit.score - max(elsewhere, default=0.0) < p.better:
        return parts
    edge = np.concatenate(((first, second, fit.x, fit.y, fit.heading), fit.information * p.trust))
    return parts._replace(edges=torch.cat((parts.edges, torch.from_numpy(edge)[None])))


def likely(fit: Fit, start: Floats, sure: Floats, p: PartParams) -> bool:
    """Whether a fit is where it may be, for all that is known of the two parts before."""
    off = np.array((fit.x, fit.y, fit.heading)) - start
    off[2] = wrapped(off[2])
    said = np.array(fit.information)[[0, 1, 3, 1, 2, 4, 3, 4, 5]].reshape(3, 3) * p.trust + 1e-3 * np.eye(3)
    return float(off @ np.linalg.solve(sure + np.linalg.inv(said), off)) < p.unlikely
