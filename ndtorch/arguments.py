"""The check at the public edge: whether an argument is a tensor that can be computed with."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Iterable
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ndtorch.errors import InputError

FEW = 64
"""So many numbers are added sooner in Python than torch is called."""

MOST_PIXELS = 2**24
"""Pixels of the largest frames that are computed with, 4096 x 4096: a plane of them takes 64 MiB."""

MOST_ROWS = 100_000
"""Time steps of the longest memory of single numbers or frames."""

LARGEST = 1e12
"""Largest number that is computed with: the cube of more lies beyond single precision."""

WITHIN = f"within {LARGEST:g} of 0"

USUAL = (torch.float32, torch.float64)

PLAIN = (Tensor, torch.nn.Parameter)


def has_values(value: Tensor) -> bool:
    """Whether the numbers of a tensor can be looked at: not while a program is compiled or exported, on the device
    `meta`, in `FakeTensorMode`, or inside transforms of `torch.func`.
    """
    if torch.compiler.is_compiling() or type(value) not in PLAIN or value.is_meta:
        return False
    try:
        value.data_ptr()  # what `torch.vmap` and `torch.func.grad` wrap has none
    except RuntimeError:
        return False
    return True


def check_tensor(name: str, value: object, *, half: bool = True, finite: bool = True, meta: bool = False) -> None:
    """Raise `InputError` unless `value` is a dense floating point tensor of finite numbers.

    Numbers are looked at where there are any, see `has_values`.

    Args:
        name: of the argument, for the message.
        half: whether float16 and bfloat16 will do.
        finite: look for NaN and infinity, which costs one sum.
        meta: whether a tensor without numbers will do.
    """
    check_dense(name, value, meta=meta)
    assert isinstance(value, Tensor)
    if not value.is_floating_point():
        raise InputError(f"{name} must be floating point, got {value.dtype}")
    if not half and value.dtype not in USUAL:
        raise InputError(f"{name} must be float32 or float64, got {value.dtype}")
    if finite:
        check_finite(name, value)


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


def as_path(name: str, value: object) -> Path:
    """A path that may be given as text; raises `InputError` for anything else."""
    if not isinstance(value, str | Path):
        raise InputError(f"{name} must be a path, got {type(value).__name__}")
    return Path(value)


def as_device(device: torch.device | str) -> torch.device:
    """A device; raises `InputError` for a name that PyTorch does not know."""
    try:
        return torch.device(device)
    except (RuntimeError, TypeError) as error:
        raise InputError(f"device must be one of PyTorch, as cpu or cuda:0, got {repr(device)[:40]}") from error


def check_kind(name: str, value: object, kind: type) -> None:
    """Raise `InputError` unless `value` is None or of that class."""
    if value is not None and not isinstance(value, kind):
        raise InputError(f"{name} must be a {kind.__name__} or None, got {type(value).__name__}")


def check_state(state: Any, kind: type) -> None:
    """Raise `InputError` unless `state` is None or of the class that the module returns."""
    check_kind("state", state, kind)


def check_batch(state: Any, batch: tuple[int, ...], *names: str) -> None:
    """Raise `InputError` unless a state is None, or these tensors of it are floating point and begin with the batch of
    the input: to look at all of them would take as long as some steps do."""
    if state is None or torch.compiler.is_compiling():
        return
    for name in names:
        value = getattr(state, name)
        if value.shape[: len(batch)] != batch:
            raise InputError(f"state.{name} must begin with {tuple(batch)} as the input does, got {tuple(value.shape)}")
        if not value.is_floating_point():
            raise InputError(f"state.{name} must be floating point, got {value.dtype}")


def check_fits(name: str, value: Tensor, like: Tensor) -> None:
    """Raise `InputError` unless a filter's memory is on the device and of the type of a sample, and of a size that goes
    with it."""
    if torch.compiler.is_compiling():
        return
    if value.device != like.device:
        raise InputError(f"{name} must be on {like.device} as the input is, got {value.device}")
    if value.dtype == like.dtype and value.shape == like.shape:
        return
    if value.dtype != like.dtype:
        raise InputError(f"{name} must be {like.dtype} as the input is, got {value.dtype}")
    if any(a != b and 1 not in (a, b) for a, b in zip(reversed(value.shape), reversed(like.shape), strict=False)):
        raise InputError(f"{name} must go with samples {tuple(like.shape)}, got {tuple(value.shape)}")


def check_alike(name: str, value: Tensor, like: Tensor) -> None:
    """Raise `InputError` unless samples that are kept are on the device and of the size of those that come."""
    if value.device != like.device:
        raise InputError(f"{name} must be on {like.device} as the input is, got {value.device}")
    if value.shape != like.shape and not torch.compiler.is_compiling():
        raise InputError(f"{name} must be {tuple(like.shape)} as the input is, got {tuple(value.shape)}")


def check_finite(name: str, value: Tensor) -> None:
    """Raise `InputError` where floating point numbers are NaN or infinite."""
    if not has_values(value):
        return
    if value.numel() == 1:
        # Several times quicker: what a car drove is looked at in every step.
        number = value.item()
        if abs(number) <= LARGEST:
            return
        raise InputError(f"{name} must be {WITHIN if math.isfinite(number) else 'finite'}, got {number}")
    # NaN, infinity and what is too large survive a sum. Many numbers may add up to more: the second look decides.
    if not abs(value.detach().sum()) <= LARGEST:
        if not bool(torch.isfinite(value).all()):
            raise InputError(f"{name} must be finite, got NaN or infinite values")
        if not bool((value.abs() <= LARGEST).all()):
            raise InputError(f"{name} must be {WITHIN}, got {value.abs().max():g}")


def surely_finite(values: Iterable[object]) -> bool:
    """Whether these are dense tensors of finite float32 or float64, by one look at all of them: for every step of a
    car. False says nothing, since a sum of finite numbers may overflow.
    """
    total = 0.0
    try:
        for value in values:
            if type(value) is not Tensor or value.dtype not in USUAL or value.is_sparse:
                return False
            count = value.numel()
            if count == 1:
                total += value.item()
            else:
                total += sum(value.reshape(-1).tolist()) if count <= FEW else float(value.detach().sum())
    except RuntimeError:  # a meta tensor has no numbers to give
        return False
    return math.isfinite(total)


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
    if len(sides) == 2 and all(isinstance(side, Integral) and is_number(side) and int(side) >= least for side in sides):
        if math.prod(map(int, sides)) <= MOST_PIXELS:
            return
        raise InputError(f"{name} must be {MOST_PIXELS} pixels in all at most, got {repr(value)[:40]}")
    pixels = "pixel" if least == 1 else "pixels"
    raise InputError(f"{name} must be a height and a width of at least {least} {pixels}, got {repr(value)[:40]}")


def rows_in(name: str, seconds: float, dt: float, least: int = 1) -> int:
    """How many time steps a memory of so many seconds holds. Raises `InputError`: more than `MOST_ROWS`."""
    rows = seconds / dt
    if not rows <= MOST_ROWS:
        raise InputError(f"{name} must be {MOST_ROWS} time steps of {dt:g} s at most, got {seconds:g} s")
    return max(least, round(rows))


def check_numbers(
    params: Any,
    *,
    endless: Collection[str] = (),
    positive: Collection[str] | None = None,
    signed: Collection[str] = (),
) -> None:
    """Raise `InputError` where a field of a dataclass is not of the kind of its default: a truth value, a whole number,
    a number, or a tuple of numbers; None may take the place of a number or a tuple where it is the default.

    NaN is no number. Infinity is one where it is the default, where the field is a time constant, `tau_...`, and where
    the field is one of `endless`.

    Args:
        positive: fields that must be above 0, where all other numbers must be 0 or above, except those of `signed`;
            None where a number may have any sign.
    """
    for field in dataclasses.fields(params):
        value, usual = getattr(params, field.name), field.default
        if isinstance(usual, bool):
            wanted = "" if isinstance(value, bool) else "True or False"
        elif isinstance(usual, int):
            wanted = "" if not isinstance(value, bool) and isinstance(value, Integral) else "a whole number"
        elif isinstance(value, tuple) and (isinstance(usual, tuple) or "tuple" in str(field.type)):
            wanted = "" if all(map(is_finite, value)) else "finite numbers"
        elif isinstance(usual, float) and math.isinf(usual):
            wanted = "" if is_number(value) else "a number"
        elif isinstance(usual, float) or (usual is None and value is not None):
            wanted = what_number(field.name, value, field.name in endless)
        else:
            continue
        if wanted:
            raise InputError(f"{field.name} must be {wanted}, got {repr(value)[:40]}")
    for name, value in vars(params).items():
        if positive is None or name in signed or isinstance(value, bool) or not isinstance(value, Real):
            continue
        if value < 0 or (value == 0 and name in positive):
            raise InputError(f"{name} must be {'> 0' if name in positive else '>= 0'}, got {value}")


def what_number(name: str, value: object, endless: bool = False) -> str:
    """What a field of that name wants instead of this value, empty where it will do: only a `tau_...` may be infinite,
    unless `endless`.
    """
    if not is_number(value):
        return "a number"
    forgets_nothing = name.startswith("tau_") and value == math.inf
    return "" if endless or forgets_nothing or is_finite(value) else "a finite number"


def is_number(value: object) -> bool:
    """Whether it is a number that float64 can hold, or infinity."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return False
    try:
        return not math.isnan(float(value))
    except OverflowError:
        return False


def is_whole(value: object) -> bool:
    """Whether it is a whole number: of Python, or of NumPy."""
    return isinstance(value, Integral) and not isinstance(value, bool)


def is_finite(value: object) -> bool:
    """Whether it is a number that float64 can hold, and not infinity."""
    return isinstance(value, Real) and is_number(value) and math.isfinite(value)
