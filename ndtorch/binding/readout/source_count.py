"""How many sources the sums hold, and the times at which no source covers another."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.binding.covariance import CovarianceState
from ndtorch.binding.normalise import divide, group_max, spread_groups
from ndtorch.binding.readout.owners import SumCriteria
from ndtorch.vision.features import GROUPS

LINEAR = slice(GROUPS["motion"].stop, 10)
"""Signals that are proportional to brightness: orientations and colors."""
COLORS = 3
"""Signals of color."""
WAYS = 4
"""Signals of motion: so many sources move every way there is."""
NOTHING = 1e-6
"""Share of the largest that single precision leaves in a direction without anything."""
KNOWN = 0.05
"""Share of the largest under which a direction of motion is none."""
WEAKEST = 3
"""Directions that are taken for noise."""


def stands_out(without: Tensor, delayed: Tensor, share: float, limits: SumCriteria) -> Tensor:
    """How many directions of the covariance at the shortest delay `[B, N, N]` stand out of the noise, `[B]`."""
    values = torch.linalg.eigvalsh(delayed)
    top = values[:, -1]
    # What is left of noise with a delay, and what noise there is without.
    colored = values[:, :WEAKEST].abs().mean(-1)
    white = torch.linalg.eigvalsh(without)[:, :WEAKEST].mean(-1)
    least = torch.stack([share * top, limits.colored * colored, limits.white * white]).amax(0)
    count = (values > least.unsqueeze(-1)).sum(-1)
    return torch.where(top > limits.clear * colored, count, 0)


def crowded(without: Tensor, delayed: Tensor, limits: SumCriteria) -> Tensor:
    """Whether orientations and colors hold `crowd` sources at least, which leaves few directions to noise, `[B]`."""
    values = torch.linalg.eigvalsh(delayed)
    white = torch.linalg.eigvalsh(without)[:, 0]
    least = torch.stack([limits.faintest * values[:, -1], limits.apart * values[:, 0].abs(), limits.white * white])
    crowd: Tensor = values[:, -limits.crowd] > least.amax(0)
    return crowd


def full(without: Tensor, delayed: Tensor, limits: SumCriteria) -> Tensor:
    """Whether sources leave but one direction of orientations and colors to noise, which has next to none, `[B]`.

    A single direction says little about noise, so this is asked only where it and what is there at once hold less than
    `quiet`.
    """
    values = torch.linalg.eigvalsh(delayed)
    top, weakest = values[:, -1], torch.maximum(values[:, 0].abs(), torch.linalg.eigvalsh(without)[:, 0])
    least = torch.maximum(limits.least_alone * top, limits.alone * weakest)
    held: Tensor = (values[:, 1] > least) & (weakest < limits.quiet * top)
    return held


def empty(without: Tensor, delayed: Tensor, limits: SumCriteria) -> tuple[Tensor, Tensor]:
    """Whether two directions hold next to nothing beside a fourth source, and whether they hold nothing, `[B]` each.

    Two such directions say that there is hardly any noise, so that the fourth source may be fainter than `faintest`.
    Where they hold nothing at all, orientations and colors are an exact mixture and show every source.
    """
    values = torch.linalg.eigvalsh(delayed)
    top, weakest = values[:, -1], torch.maximum(values[:, 1].abs(), torch.linalg.eigvalsh(without)[:, 1])
    four = values[:, 2] > torch.maximum(limits.least_alone * top, limits.alone * weakest)
    return four, four & (weakest < NOTHING * top)


def unexplained(plain: Tensor, delayed: Tensor, count: Tensor, limits: SumCriteria) -> Tensor:
    """Whether motion goes its own way, beside the sources of orientations and colors, `[B]`.

    Bars alike in color and orientation are one source of those, and two of motion. Motion holds brightness times
    itself, a little of which no source explains; and noise, beside which this is not asked.
    """
    found = torch.zeros(len(delayed), dtype=torch.bool, device=delayed.device)
    motion = GROUPS["motion"]
    for m in range(1, 6):
        at = (count == m).nonzero().squeeze(-1)
        if len(at) == 0:
            continue
        here = delayed[at]
        values, vectors = torch.linalg.eigh(here[:, LINEAR, LINEAR])
        white = vectors[..., -m:] / values[:, None, -m:].clamp_min(1e-12).sqrt()
        along = here[:, motion, LINEAR] @ white
        # Motion of a known source has a time course of its own: that is no other source. Another moves another way.
        other = torch.eye(WAYS, dtype=along.dtype, device=along.device).expand(len(at), WAYS, WAYS)
        if m < WAYS:
            other = other - along @ torch.linalg.pinv(along, rtol=KNOWN)
        left, at_once = (
            torch.linalg.eigvalsh(other @ (part[:, motion, motion] - along @ along.mT) @ other.mT)[:, -1]
            for part in (here, plain[at])
        )
        largest = torch.linalg.eigvalsh(here[:, motion, motion])[:, -1]
        noise = torch.maximum(values[:, 0].abs(), torch.linalg.eigvalsh(plain[at][:, LINEAR, LINEAR])[:, 0])
        clean = noise < limits.quiet * values[:, -1]
        # White noise is gone after the delay.
        found[at] = clean & (left > (limits.elsewhere if m < WAYS else limits.moved) * largest) & (left > 0.5 * at_once)
    return found


EXACT = 1e-6
"""The same share where a residual is to be nothing."""
ROUNDS = 6
"""What is left out changes what orientations hold beside colors: so often at most."""
RIDGE = 1e-4
"""Share of the colors' power that is added to each of them where orientations are explained by them."""
LEAST_POWER = 1e-12
"""Power of colors over that of the largest, under which there is none."""
LEAST_PRODUCT = 1e-6
"""Share of the largest under which a direction of products of colors is none."""


def undisturbed(statistics: CovarianceState, tau: float, piece: float, limits: SumCriteria) -> Tensor:
    """Covariances `[..., L, 10, 10]` of the stretches of time without disturbance, the latest with the most weight
    (`tau`), as strong as a memory of all of them.
    """
    held, age = statistics.held.to(statistics.pieces), statistics.age.unsqueeze(-1)
    pieces = statistics.pieces / held.clamp_min(1)[:, None, None, None]
    count, there = len(held), held > 0
    since = piece * torch.arange(count - 1, -1, -1, dtype=pieces.dtype, device=pieces.device)
    weight = held * torch.exp(-since / tau)
    total = (weight[:, None, None, None] * pieces).sum(-4) / weight.sum().clamp_min(1)
    scale = spread_groups(group_max(total[..., 0, :, :].diagonal(dim1=-2, dim2=-1).clamp_min(0).sqrt()))
    delayed = divide(pieces[..., 1, :, :], (scale.unsqueeze(-1) * scale.unsqueeze(-2)).unsqueeze(-3)).double()
    keep = there.expand(delayed.shape[:-2])
    for _ in range(ROUNDS):
        left = beside_colors(delayed, keep * weight, there, limits)
        if bool((left == keep).all()):
            break
        keep = left
    chosen = keep * weight
    share = chosen * (1 - torch.exp(-age / tau)) / chosen.sum(-1, keepdim=True).clamp_min(1e-12)
    found: Tensor = (share[..., None, None, None] * pieces).sum(-4)
    return found


def beside_colors(delayed: Tensor, weight: Tensor, there: Tensor, limits: SumCriteria) -> Tensor:
    """Which pieces `[..., P]` hold no more beside the colors than most do, by covariances `[..., P, 10, 10]` at the
    shortest delay and their weights.
    """
    orientation, color = GROUPS["orientation"], GROUPS["color"]
    whole = (weight[..., None, None] * delayed).sum(-3) / weight.sum(-1).clamp_min(1e-12)[..., None, None]
    rest = beside(delayed, whole[..., color, color], whole[..., color, orientation])
    left = rest.diagonal(dim1=-2, dim2=-1).sum(-1)
    middle = torch.where(there, left, torch.nan).nanmedian(-1, keepdim=True).values
    largest = whole[..., orientation, orientation].diagonal(dim1=-2, dim2=-1).sum(-1, keepdim=True)
    kept: Tensor = there & (left <= torch.maximum(limits.covered * middle, limits.beside * largest))
    return kept


class Bound(NamedTuple):
    """How many sources orientations and colors hold at most, and how clear that is.

    Attributes:
        most: sources, `[...]`, int64; all that orientations and colors can hold where they are an exact mixture.
        colors: of these the ones that colors tell apart.
        further: whether motion says that there are more than those, `[...]` bool.
        margin: smallest distance of a direction from its threshold, in powers of e of its share, `[...]`.
    """

    most: Tensor
    colors: Tensor
    further: Tensor
    margin: Tensor


def motion_residual(products: CovarianceState) -> Tensor:
    """Share of the largest direction of motion that products of colors with delayed colors do not account for, `[...]`.

    A motion detector multiplies brightness with its own past. So the motion of bars is a fixed mixture of such products
    of each bar's brightness, and that of colors' while there are as many directions of colors as bars, also where bars
    pass each other. One bar more, and colors do not know the brightness of any.
    """
    held = products.covariances[..., 0, 0, :, :].double()
    deviation = held.diagonal(dim1=-2, dim2=-1).clamp_min(0).sqrt()
    motion, known = slice(0, WAYS), slice(WAYS, None)
    # Ways of motion keep their sizes against each other; of what is known each counts alike.
    largest = deviation[..., motion].amax(-1, keepdim=True)
    scale = torch.cat([largest.expand_as(deviation[..., motion]), deviation[..., known]], -1)
    normal = divide(held, scale.unsqueeze(-1) * scale.unsqueeze(-2))
    values, vectors = torch.linalg.eigh(normal[..., known, known])
    # Directions of products that hold next to nothing explain noise.
    inverse = torch.where(values > LEAST_PRODUCT * values[..., -1:], 1 / values, 0.0)
    shared = vectors.mT @ normal[..., known, motion]
    left = normal[..., motion, motion] - shared.mT @ (inverse.unsqueeze(-1) * shared)
    values = torch.linalg.eigvalsh(torch.stack([left, normal[..., motion, motion]]))[..., -1]
    share: Tensor = values[0] / values[1].clamp_min(1e-12)
    return share


def source_bound(statistics: CovarianceState, motion: Tensor, limits: SumCriteria) -> Bound:
    """Sources by colors, and by what motion and orientations hold beside them.

    Colors add up exactly, also where bars cover each other: as many directions as bars of different color. Orientations
    do not, since filters reach over several bars: bars that pass each other make further directions without a further
    bar. So motion says whether there are more sources than colors. How many more, orientations say: a bar fluctuates in
    every second, bars pass each other in some.
    """
    orientation, color = GROUPS["orientation"], GROUPS["color"]
    held = statistics.held.to(statistics.pieces)
    pieces = (statistics.pieces / held.clamp_min(1)[:, None, None, None])[..., :2, :, :]
    total = (held[:, None, None, None] * pieces).sum(-4) / held.sum().clamp_min(1)
    scale = spread_groups(group_max(total[..., 0, :, :].diagonal(dim1=-2, dim2=-1).clamp_min(0).sqrt()))
    unit = scale.unsqueeze(-1) * scale.unsqueeze(-2)
    delayed = divide(pieces[..., 1, :, :], unit.unsqueeze(-3)).double()
    whole = divide(total[..., 1, :, :], unit).double()
    largest = torch.linalg.eigvalsh(whole[..., orientation, orientation])[..., -1:].clamp_min(1e-12)
    quiet, every = (torch.linalg.eigvalsh(quietest(delayed, held, share)) / largest for share in (limits.quietest, 1.0))
    of_colors = torch.linalg.eigvalsh(whole[..., color, color])
    shares = of_colors / of_colors[..., -1:].clamp_min(1e-12)
    colors = (shares > limits.faintest).sum(-1)
    further = motion > limits.motion_residual
    # Where colors have a direction left, a further source would have to be of a color that is there.
    alike = further & (quiet[..., -1] > limits.same_color_residual)
    lasting = (quiet > limits.lasting * every) & (quiet > limits.least_lasting)
    most = colors + torch.where(colors == COLORS, further * (1 + lasting[..., :-1].sum(-1)), alike)
    # Where a direction of the orientations holds nothing, no bars pass each other.
    exact = torch.linalg.eigvalsh(
        beside(whole.unsqueeze(-3), whole[..., color, color], whole[..., color, orientation], EXACT)
    )
    most = torch.where(exact[..., 0, 0] < NOTHING * largest[..., 0], LINEAR.stop - LINEAR.start, most)
    ratio = torch.cat([shares / limits.faintest, (motion / limits.motion_residual).unsqueeze(-1)], -1)
    return Bound(most, colors, further, ratio.clamp(1e-9, 1e9).log().abs().amin(-1))


def quietest(delayed: Tensor, held: Tensor, share: float) -> Tensor:
    """Covariance `[..., 3, 3]` of orientations beside colors in the `share` of pieces that hold least of it; colors are
    fitted to these pieces alone (least trimmed squares).
    """
    orientation, color = GROUPS["orientation"], GROUPS["color"]
    count = max(1, math.ceil(share * int((held > 0).sum())))
    selected = held.double().expand(delayed.shape[:-2])
    residual = delayed[..., orientation, orientation]
    for _ in range(ROUNDS):
        fitted = (selected[..., None, None] * delayed).sum(-3) / selected.sum(-1).clamp_min(1e-12)[..., None, None]
        residual = beside(delayed, fitted[..., color, color], fitted[..., color, orientation])
        left = residual.diagonal(dim1=-2, dim2=-1).sum(-1).masked_fill(held == 0, torch.inf)
        selected = (left.argsort(dim=-1, stable=True).argsort(-1) < count) * held.double()
    chosen: Tensor = (selected[..., None, None] * residual).sum(-3)
    return chosen / selected.sum(-1).clamp_min(1e-12)[..., None, None]


def beside(delayed: Tensor, colors: Tensor, shared: Tensor, share: float = RIDGE) -> Tensor:
    """Covariances of orientations in every piece `[..., P, 3, 3]` less what colors explain; `share` of the colors'
    power is added to each of them.
    """
    orientation, color = GROUPS["orientation"], GROUPS["color"]
    power = colors.diagonal(dim1=-2, dim2=-1).sum(-1)[..., None, None]
    eye = torch.eye(3, dtype=colors.dtype, device=colors.device)
    # Colors that do not fluctuate explain nothing: their covariance at a delay is rounding, and may have no inverse.
    known = power > LEAST_POWER
    inverted = torch.where(known, colors + share * power * eye, eye)
    explained = torch.linalg.solve(inverted, torch.where(known, shared, 0.0)).mT.unsqueeze(-3)
    both = explained @ delayed[..., color, orientation]
    rest: Tensor = (
        delayed[..., orientation, orientation] - both - both.mT + explained @ delayed[..., color, color] @ explained.mT
    )
    return rest
