"""Checks at the doors of the package: tensors, states, sizes, options, and which backend computes."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
import os
import sys
from collections.abc import Callable, Collection
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Literal, Self, TypeVar, get_args

import torch
from torch import Tensor, nn

from ndtorch.errors import InputError

MOST_PIXELS = 2**24
"""Pixels of the largest frames that are computed with, 4096 x 4096: a plane of them takes 64 MiB."""

LARGEST = 1e12
"""Largest number that is computed with: the cube of more lies beyond single precision."""

USUAL = (torch.float32, torch.float64)


def has_values(*values: Tensor) -> bool:
    """Whether the numbers of tensors can be looked at: not while a program is compiled or exported, on the device
    `meta`, in `FakeTensorMode`, or inside transforms of `torch.func`.
    """
    if torch.compiler.is_compiling():
        return False
    for value in values:
        if type(value) not in (Tensor, nn.Parameter) or value.is_meta:
            return False
        try:
            value.data_ptr()  # what `torch.vmap` and `torch.func.grad` wrap has none
        except RuntimeError:
            return False
    return True


Backend = Literal["auto", "numba", "torch"]
"""`auto` takes kernels wherever they can do the work; `numba` refuses what they cannot do; `torch` takes none."""

KERNELS = os.environ.get("NDTORCH_KERNELS", "1") != "0"
"""With 0 in this environment variable, `auto` means torch."""


def check_backend(backend: str) -> Backend:
    """The backend of this name. Raises `InputError`: there is none."""
    if backend not in get_args(Backend):
        raise InputError(f"backend must be one of {', '.join(get_args(Backend))}, got {backend!r}")
    return backend  # type: ignore[return-value]


def set_backend(module: nn.Module, backend: str) -> None:
    """Set the backend of a module and of everything in it that has a choice."""
    chosen = check_backend(backend)
    if chosen == "torch" and getattr(module, "kernels_only", False):
        raise InputError(f"{getattr(module, 'name', 'this module')} has compiled kernels only; leave backend out")
    for part in module.modules():
        if hasattr(part, "backend"):
            part.backend = chosen  # type: ignore[assignment]


def kernels_wanted(*tensors: Tensor, backend: Backend = "auto") -> bool:
    """Whether kernels are to be used for these tensors: on the CPU, without gradients, and holding numbers (see
    `has_values`).
    """
    if backend == "torch" or torch.compiler.is_compiling() or (backend == "auto" and not KERNELS):
        return False
    gradients = torch.is_grad_enabled()
    possible = has_values(*tensors)
    for tensor in tensors:
        possible &= tensor.is_cpu and not (tensor.requires_grad and gradients)
    if backend == "numba" and not possible:
        raise InputError("backend='numba' needs tensors on the CPU that need no gradient")
    return possible


Function = TypeVar("Function", bound=Callable[..., Any])


def without_autocast(function: Function) -> Function:
    """Decorator of a method: `torch.autocast` is off inside, so it computes in the precision of its inputs."""

    @functools.wraps(function)
    def call(*args: Any, **options: Any) -> Any:
        devices = [kind for kind in ("cpu", "cuda") if torch.is_autocast_enabled(kind)]
        if not devices:
            return function(*args, **options)
        with contextlib.ExitStack() as stack:
            for kind in devices:
                stack.enter_context(torch.autocast(kind, enabled=False))
            return function(*args, **options)

    return call  # type: ignore[return-value]


class FullPrecision(nn.Module):
    """A module of single or double precision.

    Raises:
        InputError: conversion to another type (`half`, `to`, `type`), also of a module around it. In half precision
            sums over an image and small weights are nothing.
    """

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> Self:
        made = fn(torch.zeros(1)).dtype
        if made not in USUAL:
            name = getattr(self, "name", type(self).__name__)
            raise InputError(f"{name} computes in single or double precision, got {made}")
        moved: Self = super()._apply(fn, recurse)  # type: ignore[no-untyped-call]
        return moved


def check_tensor(name: str, value: object, *, half: bool = True, finite: bool = True, meta: bool = False) -> None:
    """Raise `InputError` unless `value` is a dense floating point tensor of finite numbers.

    Args:
        name: of the argument, for the message.
        half: whether float16 and bfloat16 will do.
        finite: look for NaN and infinity, which costs one sum, where numbers can be looked at (`has_values`).
        meta: whether a tensor without numbers will do.
    """
    check_dense(name, value, meta=meta)
    assert isinstance(value, Tensor)
    if not value.is_floating_point() or not (half or value.dtype in USUAL):
        raise InputError(f"{name} must be {'floating point' if half else 'float32 or float64'}, got {value.dtype}")
    # NaN, infinity and what is too large survive a sum. Many numbers may add up to more: the second look decides.
    if finite and has_values(value) and not abs(value.detach().sum().item()) <= LARGEST:
        if not bool(torch.isfinite(value).all()):
            raise InputError(f"{name} must be finite, got NaN or infinite values")
        if not bool((value.abs() <= LARGEST).all()):
            raise InputError(f"{name} must be within {LARGEST:g} of 0, got {value.abs().max():g}")


def check_dense(name: str, value: object, *, meta: bool = False) -> None:
    """Raise `InputError` unless `value` is a tensor that holds all of its numbers, of whatever type; with `meta` also
    where it holds none."""
    if not isinstance(value, Tensor):
        hint = "; convert it with torch.from_numpy" if type(value).__module__ == "numpy" else ""
        raise InputError(f"{name} must be a torch.Tensor, got {type(value).__name__}{hint}")
    if value.layout != torch.strided:
        raise InputError(f"{name} must be dense, got {value.layout}")
    if value.is_meta and not meta and not torch.compiler.is_compiling():
        raise InputError(f"{name} must hold numbers, got a meta tensor")


def check_state(state: Any, kind: type, name: str = "state") -> None:
    """Raise `InputError` unless `state` is None or of the class that the module returns."""
    if state is not None and not isinstance(state, kind):
        raise InputError(f"{name} must be a {kind.__name__} or None, got {type(state).__name__}")


def check_batch(state: Any, batch: tuple[int, ...], *names: str) -> None:
    """Raise `InputError` unless a state is None, or these tensors of it begin with the batch of the input."""
    for name in names if state is not None and not torch.compiler.is_compiling() else ():
        shape = tuple(getattr(state, name).shape)
        if shape[: len(batch)] != tuple(batch):
            raise InputError(f"state.{name} must begin with {tuple(batch)} as the input does, got {shape}")


def as_path(name: str, value: object) -> Path:
    """A path that may be given as text; raises `InputError` for anything else."""
    if not isinstance(value, str | Path):
        raise InputError(f"{name} must be a path, got {type(value).__name__}")
    return Path(value)


def check_number(
    name: str,
    value: object,
    *,
    least: float | None = None,
    above: float | None = None,
    unit: str = "",
    whole: bool = False,
    endless: bool = False,
) -> None:
    """Raise `InputError` unless `value` is a number, `least` or more, and more than `above`.

    Args:
        name: of the argument, for the message.
        unit: what it counts, for the message: "seconds".
        whole: only whole numbers will do.
        endless: infinity will do.
    """
    if is_number(value) and (endless or is_finite(value)) and (not whole or isinstance(value, Integral)):
        assert isinstance(value, Real)
        number = float(value)
        if (least is None or number >= least) and (above is None or number > above):
            return
    wanted = f"a {'whole ' if whole else ''}number{f' of {unit}' if unit else ''}"
    limits = [f"{sign} {limit:g}" for sign, limit in ((">=", least), (">", above)) if limit is not None]
    raise InputError(f"{name} must be {' '.join([wanted, *limits])}, got {repr(value)[:40]}")


def check_size(name: str, value: object, least: int) -> None:
    """Raise `InputError` unless `value` is a height and a width in pixels, each `least` or more."""
    sides = value if isinstance(value, tuple | list) else ()  # torch.Size is a tuple
    if len(sides) != 2 or not all(is_whole(side) and side >= least for side in sides):
        raise InputError(f"{name} must be a height and a width of at least {least} pixels, got {repr(value)[:40]}")
    if math.prod(map(int, sides)) > MOST_PIXELS:
        raise InputError(f"{name} must be {MOST_PIXELS} pixels in all at most, got {repr(value)[:40]}")


def check_numbers(
    params: Any,
    *,
    endless: Collection[str] = (),
    positive: Collection[str] | None = None,
    signed: Collection[str] = (),
) -> None:
    """Raise `InputError` where a number of a dataclass is not of the kind of its default.

    Truth values, whole numbers and tuples of numbers stay so; numbers are finite, but for those whose default is not,
    for time constants, `tau_...`, and for those of `endless`.

    Args:
        positive: fields that must be above 0, where all other numbers must be 0 or above, except those of `signed`;
            None where a number may have any sign.
    """
    for field in dataclasses.fields(params):
        name, value, usual = field.name, getattr(params, field.name), field.default
        wanted = ""
        if isinstance(usual, bool):
            wanted = "" if isinstance(value, bool) else "True or False"
        elif isinstance(usual, int):
            wanted = "" if is_whole(value) else "a whole number"
        elif isinstance(value, tuple):
            wanted = "" if all(map(is_finite, value)) or not isinstance(usual, tuple) else "finite numbers"
        elif isinstance(usual, float):
            infinite = name in endless or name.startswith("tau_") or math.isinf(usual)
            wanted = "" if is_finite(value) or (infinite and is_number(value)) else "a finite number"
        limited = not wanted and positive is not None and name not in signed and is_number(value)
        if limited and (value < 0 or (value == 0 and name in (positive or ()))):
            wanted = "> 0" if name in (positive or ()) else ">= 0"
        if wanted:
            raise InputError(f"{name} must be {wanted}, got {repr(value)[:40]}")


def is_number(value: Any) -> bool:
    """Whether it is a number, or infinity."""
    return type(value) is not bool and isinstance(value, Real) and bool(value == value)


def is_whole(value: Any) -> bool:
    """Whether it is a whole number: of Python, or of NumPy."""
    return isinstance(value, Integral) and not isinstance(value, bool)


def is_finite(value: Any) -> bool:
    """Whether it is a number that float64 can hold, and not infinity."""
    return is_number(value) and bool(abs(value) <= sys.float_info.max)
