"""What must hold of every module with a state: chunks, batches, resuming, types and finite numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import torch
from hypothesis import HealthCheck, settings
from torch import Tensor, nn

from ndtorch import binding, navigation, vision
from ndtorch.utils.files import read_tensors, save_tensors
from ndtorch.utils.tensors import leaves, mapped

Streams = tuple[Any, ...]
"""What a module is given, in nested tuples of tensors `[B, T, ...]`."""

PUBLIC: tuple[ModuleType, ...] = (vision, binding, navigation)
SIZE = (16, 20)
RIG = navigation.StereoRig(width=160, height=120, focal=107.5)
DT = 1 / 30
QUICK = settings(
    max_examples=4, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck)
)
LONG = settings(QUICK, max_examples=200, derandomize=False)

KINDS = ("noise", "edges", "black", "white", "still", "faint", "flash")


def samples(shape: Sequence[int], kind: str, chance: torch.Generator) -> Tensor:
    """Float64 numbers in 0..1, `[B, T, ...]`: pictures, rows or signals as no camera, or a bad one, would give them."""
    some = torch.rand(tuple(shape), generator=chance, dtype=torch.float64)
    if kind == "noise":
        return some
    time = torch.arange(shape[1], dtype=torch.float64).view(1, -1, *[1] * (len(shape) - 2))
    if kind == "edges":  # broad stripes that move, another way in every trial
        start = some.flatten(1)[:, :1].view(-1, *[1] * (len(shape) - 1))
        return (0.5 + 0.4 * torch.sin(torch.arange(shape[-1]) * 0.9 + time + 6 * start).sign()).expand(*shape).clone()
    if kind == "black":
        return torch.zeros_like(some)
    if kind == "white":
        return torch.ones_like(some)
    if kind == "still":
        return some[:, :1].expand_as(some)
    if kind == "faint":
        return 1e-12 * some
    return (time % 3 == 1).to(some.dtype).expand(*shape).clone()


@dataclass(frozen=True)
class Part:
    """A public module, and how it is asked.

    Args:
        make: a new one, always the same.
        given: its inputs, drawn: `given(draw)` with `draw(*shape after [B, T])`.
        batched: whether it takes several trials at once.
        final: whether its outputs are those of the last step alone.
        times: parts of its outputs that have a time but no trial, by name.
        limit: largest difference that rounding may make, as a share of the largest number, in double precision.
        double: whether it computes in double precision when asked to.
        state: whether it has one.
        fixed: what is given to it besides, the same at every step.
    """

    make: Callable[[], nn.Module]
    given: Callable[[Callable[..., Tensor]], Streams]
    batched: bool = True
    final: bool = False
    times: frozenset[str] = frozenset()
    limit: float = 1e-9
    double: bool = True
    state: bool = True
    fixed: Callable[[int], dict[str, Any]] = field(default=lambda trials: {})

    def run(self, streams: Streams, state: Any = None) -> tuple[dict[str, Tensor], Any]:
        """By a new module: its outputs by name, and its state."""
        module = self.make().double() if self.double else self.make()
        given = {"state": state} if self.state else {}
        made = module(*streams, **given, **self.fixed(len(first(streams))))
        out, state = made if self.state else (made, None)
        return leaves(out, "out"), state

    def time(self, name: str, trials: bool) -> int:
        """Dimension of time of an output."""
        return int(trials and name.rpartition(".")[2] not in self.times)


def first(streams: Streams) -> Tensor:
    return next(iter(leaves(tuple(streams)).values()))


def cut(streams: Streams, dim: int, start: int, stop: int) -> Streams:
    return tuple(mapped(stream, lambda _, x: x.narrow(dim, start, stop - start)) for stream in streams)


def trial(streams: Streams, n: int) -> Streams:
    return tuple(mapped(stream, lambda _, x: x[n]) for stream in streams)


def stored(state: Any, path: Path) -> Any:
    """A state as it comes back from a file."""
    if state is None:
        return None
    save_tensors({name: part.contiguous().clone() for name, part in leaves(state).items()}, path)
    kept = read_tensors(path, "a state")[0]
    return mapped(state, lambda name, _: kept[name])


def in_chunks(part: Part, streams: Streams, cuts: Sequence[int], path: Path) -> tuple[dict[str, Tensor], Any]:
    """Each chunk by another module, its state from a file."""
    trials = part.batched
    rows, state = [], None
    for start, stop in pairwise([0, *cuts, first(streams).shape[int(trials)]]):
        out, state = part.run(cut(streams, int(trials), start, stop), stored(state, path))
        rows.append(out)
    if part.final:
        return rows[-1], state
    return {name: torch.cat([row[name] for row in rows], part.time(name, trials)) for name in rows[0]}, state


def all_finite(where: str, tensors: dict[str, Tensor]) -> None:
    """Infinity may say that nothing was found: then it is so in every run. NaN says nothing."""
    for name, value in tensors.items():
        assert not value.is_floating_point() or not bool(torch.isnan(value).any()), f"{where}: {name} is NaN"


def same(where: str, got: dict[str, Tensor], wanted: dict[str, Tensor], limit: float) -> None:
    """Two runs gave the same, but for rounding."""
    assert got.keys() == wanted.keys(), where
    for name, value in got.items():
        there = wanted[name]
        assert value.shape == there.shape, f"{where}: {name} is {tuple(value.shape)}, not {tuple(there.shape)}"
        assert value.dtype == there.dtype, f"{where}: {name} is {value.dtype}, not {there.dtype}"
        if value.dtype == torch.bool or not value.is_floating_point():
            assert torch.equal(value, there), f"{where}: {name}"
            continue
        sound = there[torch.isfinite(there)].abs()
        scale = max(1e-12, float(sound.max())) if sound.numel() else 1.0
        off = (value - there).abs().where(value != there, 0.0).amax() if value.numel() else 0.0
        assert float(off) <= limit * scale, f"{where}: {name} is off by {float(off):.3g} of {scale:.3g}"


def check(part: Part, streams: Streams, cuts: Sequence[int], path: Path) -> None:
    """All properties, for one input `[B, T, ...]`."""
    streams = streams if part.batched else trial(streams, 0)
    whole, state = part.run(streams)
    all_finite("outputs", whole)
    all_finite("state", leaves(state))
    chunks, resumed = in_chunks(part, streams, cuts, path)
    same("in chunks", chunks, whole, part.limit)
    same("state after chunks", leaves(resumed), leaves(state), part.limit)
    if not part.batched:
        return
    for n in range(first(streams).shape[0]):
        alone, _ = part.run(trial(streams, n))
        shared = part.times
        chosen = {name: value if name.rpartition(".")[2] in shared else value[n] for name, value in whole.items()}
        same(f"trial {n} alone", alone, chosen, part.limit)
    floats = {x.dtype for x in leaves(streams).values() if x.is_floating_point()}
    if part.double:
        assert {x.dtype for x in whole.values() if x.is_floating_point()} <= floats, "another type came out"
