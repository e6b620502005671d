"""Separation of sources by joint diagonalisation of covariances at several delays, without a common illumination."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.binding.learning import settled
from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.owners import SourceCriteria, SumCriteria, features_by_group
from ndtorch.binding.readout.source_count import COLORS, LINEAR, Bound, crowded, empty, full, stands_out, unexplained
from ndtorch.vision.features import GROUPS

DELAYS = (0.01, 0.05, 0.1, 0.2, 0.4, 0.8)
"""Seconds; each becomes a whole number of time steps, at least one."""


def without_lighting(separation: Separation, first_stage: Tensor, criteria: SourceCriteria) -> Separation:
    """The same without `lighting`."""
    mixing = separation.mixing
    there = torch.arange(mixing.shape[-2], device=mixing.device) < separation.sources.unsqueeze(-1)
    even = lighting(mixing, there, first_stage, criteria)
    # What is left moves to the front.
    order = torch.argsort((even | ~there).long(), dim=-1, stable=True)
    mixing = mixing.gather(-2, order.unsqueeze(-1).expand_as(mixing))
    sources = (there & ~even).sum(-1)
    rank = torch.arange(mixing.shape[-2], device=mixing.device)
    mixing = torch.where((rank < sources.unsqueeze(-1)).unsqueeze(-1), mixing, 0.0)
    return separation._replace(mixing=mixing, sources=sources)


def lighting(mixing: Tensor, there: Tensor, first_stage: Tensor, criteria: SourceCriteria) -> Tensor:
    """Which sources, `[..., S]` of `mixing` `[..., S, 10]`, are light that changes everywhere: they drive all colors
    and all orientations alike, or none, and hardly move or move every way alike.
    """
    eye = torch.eye(10, dtype=mixing.dtype, device=mixing.device)
    raw = mixing @ (eye + first_stage.to(mixing.dtype)).mT
    even = there
    for group in (raw[..., GROUPS["orientation"]], raw[..., GROUPS["color"]]):
        nothing = group.amax(-1) < criteria.absent * raw.amax(-1)
        even = even & (nothing | (group.amin(-1) >= criteria.even * group.amax(-1)))
    directed = mixing[..., GROUPS["motion"]]
    motion = torch.where(there, directed.amax(-1).clamp_min(0), 0.0)
    # Alone, it has the largest motion there is: what flickers moves every way alike, or its motion is noise.
    everywhere = (directed.amin(-1) >= criteria.even * motion) | (motion < criteria.absent * raw.amax(-1))
    return even & (everywhere | (motion < criteria.moving * motion.amax(-1, keepdim=True)))


def plain_table(
    owners: ObjectTable, weights: Tensor, first_stage: Tensor, criteria: SourceCriteria | None = None
) -> ObjectTable:
    """The owners' table without lighting, and without any owner where there are more than `most_sources`: where almost
    every signal goes its own way it is noise.
    """
    c = criteria or SourceCriteria()
    mixing = weights.mT + torch.eye(10, dtype=weights.dtype, device=weights.device)
    light = lighting(mixing, owners.owners, first_stage, c)
    noise = owners.owners.sum(-1, keepdim=True) > c.most_sources
    kept = owners.owners & ~light & ~noise
    return ObjectTable(kept, torch.where(kept.unsqueeze(-1), owners.rows, 0.0))


def assigned(mixing: Tensor, count: Tensor, weights: Tensor, smallest: float = 1 / 3) -> ObjectTable:
    """Give every source the neuron whose output is most purely that source, among the features it has.

    Shapes: mixing `[..., S, N]`, count `[...]`, weights T `[..., N, N]`.
    """
    rows = features_by_group(mixing, smallest)
    gain = (mixing @ settled(weights).mT).square()
    total = gain.sum(-2, keepdim=True).clamp_min(torch.finfo(gain.dtype).tiny)
    purity = torch.where(rows > 0, gain * gain / total, -1.0)
    owners = torch.zeros(*count.shape, mixing.shape[-1], dtype=torch.bool, device=mixing.device)
    out = torch.zeros_like(weights)
    for source in range(mixing.shape[-2]):
        score = purity[..., source, :].masked_fill(owners, -torch.inf)
        here = torch.nn.functional.one_hot(score.argmax(-1), mixing.shape[-1]).bool()
        here = here & (source < count).unsqueeze(-1)
        owners = owners | here
        out = torch.where(here.unsqueeze(-1), rows[..., source, :].unsqueeze(-2), out)
    return ObjectTable(owners, out)


class Separation(NamedTuple):
    """Sources and their mixing; S is the largest number of sources asked for.

    Attributes:
        sources: how many there are, `[...]`, int64.
        mixing: `[..., S, N]`, one row a source, the largest entry positive; zeros beyond `sources`.
        gap: smallest difference between the delay profiles of two sources, `[...]`: the sum over delays of the squared
            difference of their correlations with their own past. Near zero, those two are not identified. Infinite
            with fewer than two.
    """

    sources: Tensor
    mixing: Tensor
    gap: Tensor


def diagonalise(matrices: Tensor, sweeps: int = 12, enough: float = 1e-6) -> tuple[Tensor, Tensor]:
    """The rotation V `[B, m, m]` that makes symmetric matrices `[B, L, m, m]` as diagonal as they get together, and
    `V^T M V`, by Jacobi rotations at the angle of Cardoso and Souloumiac (1996).
    """
    m = matrices.shape[-1]
    out = matrices.clone()
    rotation = torch.eye(m, dtype=out.dtype, device=out.device).repeat(len(out), 1, 1)
    for _ in range(sweeps):
        largest = 0.0
        for p in range(m):
            for q in range(p + 1, m):
                difference = out[..., p, p] - out[..., q, q]
                between = 2 * out[..., p, q]
                on = (difference.square() - between.square()).sum(-1)
                off = 2 * (difference * between).sum(-1)
                angle = 0.5 * torch.atan2(off, on + torch.hypot(on, off))
                largest = max(largest, float(angle.abs().max()))
                turn = torch.stack([angle.cos(), -angle.sin(), angle.sin(), angle.cos()], -1).reshape(-1, 2, 2)
                pair = [p, q]
                out[..., pair] = out[..., pair] @ turn.unsqueeze(1)
                out[..., pair, :] = turn.mT.unsqueeze(1) @ out[..., pair, :]
                rotation[..., pair] = rotation[..., pair] @ turn
        if largest < enough:
            break
    return rotation, out


LIGHT_MOST = 4
"""Among more sources, of six signals, even light can be a mixture of them."""


def even_light(delayed: Tensor, count: Tensor, limits: SumCriteria) -> Tensor:
    """Orientations and colors `[B, 6]`, of unit length, of light that changes everywhere; zeros where it is no source.

    All colors change alike then, and all orientations, and nothing moves with them. A direction of such light lies in
    the space of the sources to the last digit, or not at all.
    """
    found = delayed.new_zeros(len(delayed), 6)
    plane = delayed.new_zeros(6, 2)
    plane[:3, 0] = plane[3:, 1] = 3**-0.5
    for m in range(1, LIGHT_MOST + 1):
        at = (count == m).nonzero().squeeze(-1)
        if len(at) == 0:
            continue
        values, vectors = torch.linalg.eigh(delayed[at][:, LINEAR, LINEAR])
        basis, size = vectors[..., -m:], values[:, None, -m:].clamp_min(1e-12)
        _, cosines, axes = torch.linalg.svd(basis.mT @ plane)
        light = (plane @ axes[:, 0, :, None]).squeeze(-1)
        away = (1 - cosines[:, 0].square()).clamp_min(0).sqrt()
        # What the source does by itself, and the motion that goes along with it.
        inside = basis.mT @ light.unsqueeze(-1)
        deviation = (inside / size.transpose(-1, -2).sqrt()).norm(dim=-2)
        unmix = (basis / size @ inside).squeeze(-1) / deviation
        motion = delayed[at][:, GROUPS["motion"], :]
        largest = motion[..., GROUPS["motion"]].diagonal(dim1=-2, dim2=-1).amax(-1).clamp_min(1e-12).sqrt()
        along = (motion[..., LINEAR] @ unmix.unsqueeze(-1)).squeeze(-1).abs().amax(-1)
        one_sign = axes[:, 0, 0] * axes[:, 0, 1] > -0.05
        there = (away < limits.lit) & ((along < limits.unmoved * largest) | (m == 1)) & one_sign
        found[at] = torch.where(there.unsqueeze(-1), light, 0.0)
    return found


def without(white: Tensor, light: Tensor) -> Tensor:
    """Whitening `[B, 6, m]` of the sources other than the one of direction `light` `[B, 6]`, `[B, 6, m - 1]`.

    In white coordinates sources are at right angles, so the others lie in the plane across the light.
    """
    axis = white.mT @ light.unsqueeze(-1)
    others: Tensor = white @ torch.linalg.svd(axis)[0][..., 1:]
    return others


MOST = 5
"""Sources that leave one of six directions to noise."""


class Sources(NamedTuple):
    """Sources in normalised covariances; S is the largest number asked for.

    Attributes:
        number: how many, `[...]`, int64.
        mixing: `[..., S, 10]`, unit power at the shortest delay, the largest entry positive.
        unmixing: `[..., S, 10]`, from signals to sources.
        gap: as in `Separation`.
    """

    number: Tensor
    mixing: Tensor
    unmixing: Tensor
    gap: Tensor


def sources_of(
    covariances: Tensor, criteria: SourceCriteria, limits: SumCriteria, bound: Bound | None = None
) -> Sources:
    """Count and mixing from covariances `[..., L, 10, 10]` in double precision, the first without delay.

    Light that changes everywhere is left out. Orientations and colors that are no exact mixture hold as many sources
    as `bound` says at most.
    """
    batch, most = covariances.shape[:-3], criteria.most_sources
    flat = covariances.reshape(-1, *covariances.shape[-3:])
    linear = stands_out(flat[:, 0, LINEAR, LINEAR], flat[:, 1, LINEAR, LINEAR], limits.faintest, limits)
    five = full(flat[:, 0, LINEAR, LINEAR], flat[:, 1, LINEAR, LINEAR], limits)
    four, exact = empty(flat[:, 0, LINEAR, LINEAR], flat[:, 1, LINEAR, LINEAR], limits)
    linear = torch.where(four, linear.clamp_min(MOST - 1), linear)
    linear = torch.where(five, linear.clamp_min(MOST), linear)
    many = crowded(flat[:, 0, LINEAR, LINEAR], flat[:, 1, LINEAR, LINEAR], limits)
    if bound is not None:
        # Bars that pass each other hide a fourth source in all seconds together, not in the quietest ones.
        upper = bound.most.reshape(-1)
        free = exact | (upper == LINEAR.stop - LINEAR.start)
        sure = (upper > COLORS) & (linear >= COLORS)
        linear = torch.where(free, linear, torch.where(sure, upper, linear.minimum(upper)))
        many = many & free
    every = stands_out(flat[:, 0], flat[:, 1], limits.crowded, limits)
    light = even_light(flat[:, 1], linear, limits)
    lit = light.abs().amax(-1) > 0
    wide = many & (linear > 0) & ~lit
    count = torch.where(wide & ~exact, torch.maximum(linear, every), linear)
    more = unexplained(flat[:, 0], flat[:, 1], count, limits) & ~lit
    if bound is not None:  # of those the bound says how many
        more = more & bound.further.reshape(-1) & (free | ~sure)
    wide, count = wide | more, (count + more.long()).clamp_max(most)
    found = unmixed(flat, count, wide, light, criteria)
    # Beside two of one rate, what is faint is an overtone of theirs: a shadow's edge does not dim all sums alike.
    values = torch.linalg.eigvalsh(flat[:, 1, LINEAR, LINEAR])
    fewer = (values > limits.doubtful * values[:, -1:]).sum(-1)
    if bound is not None:  # a source of a color of its own is no overtone, nor is one that three colors cannot show
        shown = torch.where(bound.colors == COLORS, bound.most, bound.colors).reshape(-1)
        fewer = torch.maximum(fewer, torch.minimum(count, shown))
    again = (found.gap < criteria.gap) & ~wide & ~lit & (fewer < count) & (fewer > 1) & ~(exact & (fewer > 2))
    if bool(again.any()):
        other = unmixed(flat, torch.where(again, fewer, count), wide, light, criteria)
        found = Sources(*(choose(again, a, b) for a, b in zip(other, found, strict=True)))
    return Sources(*(part.reshape((*batch, *part.shape[1:])) for part in found))


def unmixed(flat: Tensor, count: Tensor, wide: Tensor, light: Tensor, criteria: SourceCriteria) -> Sources:
    """So many sources `count` of covariances `[B, L, 10, 10]`, the first without delay; one is left out if it is
    `light` `[B, 6]`. Motion tells them apart too where `wide`.
    """
    most, lit = criteria.most_sources, light.abs().amax(-1) > 0
    mixing, unmixing = flat.new_zeros(len(flat), most, 10), flat.new_zeros(len(flat), most, 10)
    gap = flat.new_full((len(flat),), torch.inf)
    for m in range(1, most + 1):
        for part, kind in ((slice(0, None), wide & ~lit), (LINEAR, ~wide & ~lit), (LINEAR, lit)):
            at = ((count == m) & kind).nonzero().squeeze(-1)
            if len(at) == 0:
                continue
            here, n = flat[at], m
            values, vectors = torch.linalg.eigh(here[:, 1, part, part])
            white = vectors[..., -m:] / values[:, None, -m:].clamp_min(1e-12).sqrt()
            if bool(lit[at[0]]):
                white, n = without(white, light[at]), m - 1
            if n == 0:
                continue
            turned = white.unsqueeze(1)
            rotation, rotated = diagonalise(
                turned.mT @ here[:, 2:, part, part] @ turned, criteria.sweeps, criteria.enough
            )
            apart = (white @ rotation).mT
            mixed = (here[:, 1, :, part] @ apart.mT).mT
            sign = mixed.gather(-1, mixed.abs().argmax(-1, keepdim=True)).sign()
            mixing[at, :n] = mixed * sign
            full = flat.new_zeros(len(at), n, 10)
            full[..., part] = apart * sign
            unmixing[at, :n] = full
            if n > 1:
                profile = rotated.diagonal(dim1=-2, dim2=-1)
                squares = (profile.unsqueeze(-1) - profile.unsqueeze(-2)).square().sum(1)
                squares = squares + torch.diag_embed(squares.new_full((n,), torch.inf))
                gap[at] = squares.amin((-1, -2))
    return Sources(count - lit.long(), mixing, unmixing, gap)


def split(
    found: Separation, first_stage: Tensor, criteria: SourceCriteria, doubtful: float, least: float = 0.5
) -> tuple[Tensor, Tensor, Separation]:
    """Sources that no single object can be are two objects in its place: they fluctuate in step.

    All colors of an object brighten at once, and it moves one way. So colors of both signs are those of two objects,
    unless their plane holds two colors that are possible; each object has the features of one sign. Where colors hold
    one direction, so is motion to opposite sides, unless it is that of what flickers, all ways alike. Nothing says
    whose the other features are then, and both objects have them. Beside another color it may be motion of the other
    source. What hardly has a color of its own beside the two is where they differ a little.

    Sources of one delay profile stay as they are, since their mixing is unknown; so do all where three colors are held.

    Args:
        found: sources, through the settled first stage.
        first_stage: its weights, `[10, 10]`.
        criteria: see there.
        doubtful: share of the largest direction of colors that another one holds.
        least: share of the largest that the other sign or way has; of single bars at most .24.

    Returns:
        Whether one of the sources is two objects, whether one may be, `[...]` bool, and all sources then.
    """
    passage = settled(first_stage.to(found.mixing.dtype)).mT
    raw = torch.linalg.solve(passage, found.mixing, left=False)
    # Sources of the strongest colors first.
    color = raw[..., GROUPS["color"]]
    order = color.square().sum(-1).argsort(dim=-1, descending=True, stable=True)
    mixing = raw.gather(-2, order.unsqueeze(-1).expand_as(raw))
    motion, color = mixing[..., GROUPS["motion"]].clamp_min(0), mixing[..., GROUPS["color"]]
    values, vectors = torch.linalg.eigh(color.mT @ color)
    held = (values > doubtful * values[..., -1:].clamp_min(1e-12)).sum(-1)
    largest = color.abs().amax(-1)
    both_signs = (color.amin(-1) < -least * largest) & (color.amax(-1) > least * largest)
    normal = vectors[..., 0]
    seen = normal.abs() >= least * normal.abs().amax(-1, keepdim=True)
    one_sign = ~(seen & (normal > 0)).any(-1) | ~(seen & (normal < 0)).any(-1)
    impossible = (held == 1) | ((held == 2) & (seen.sum(-1) > 1) & one_sign)
    colors = both_signs & impossible.unsqueeze(-1)
    pairs, fastest = motion.unflatten(-1, (2, 2)).amin(-1), motion.amax(-1)
    ways = (pairs.amax(-1) >= least * fastest) & (motion.amin(-1) < criteria.even * fastest) & (fastest > 0)
    ways = ways & ~colors
    rank = torch.arange(mixing.shape[-2], device=mixing.device)
    known = (found.gap > criteria.gap) & (held < COLORS)
    there = (rank < torch.minimum(held, found.sources).unsqueeze(-1)) & known.unsqueeze(-1)
    alone = (held == 1).unsqueeze(-1)
    two = (colors | (ways & alone)) & there
    doubt = (ways & ~alone & there).any(-1)
    at = two.long().argmax(-1)
    two = two & (rank == at.unsqueeze(-1))
    # Left is before right, and down before up.
    side = 2 * pairs.argmax(-1, keepdim=True)
    first = choose(ways, mixing.scatter(-1, side, 0.0), mixing.clamp_min(0))
    second = choose(ways, mixing.scatter(-1, side + 1, 0.0), (-mixing).clamp_min(0))
    other = second.gather(-2, at[..., None, None].expand_as(mixing[..., :1, :]))
    rows = choose(two, first, mixing)
    rows = choose(rank == held.unsqueeze(-1), other.expand_as(rows), rows)
    rows = torch.where((rank <= held.unsqueeze(-1)).unsqueeze(-1), rows, 0.0)
    return two.any(-1), doubt, found._replace(sources=held + 1, mixing=rows @ passage)


def choose(where: Tensor, yes: Tensor, no: Tensor) -> Tensor:
    """`torch.where` for tensors of more dimensions than the condition."""
    return torch.where(where.reshape(where.shape + (1,) * (yes.ndim - where.ndim)), yes, no)
