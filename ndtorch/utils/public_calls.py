"""Public calls with arguments of a wrong kind: one line that names the argument, in place of an error from deep inside.

Constructors compare plain arguments with their annotations, functions only truth values and NaN. Methods look at
nothing while a call goes well. Where a call ends in an error that is no `InputError` and that it does not document, all
of its arguments are compared. Where they are what they should be, the error stays, or becomes an `InputError` with the
shapes of all tensors, where there are any and memory was not short.
"""

from __future__ import annotations

import enum
import functools
import inspect
import math
import re
import sys
import types
import typing
from collections import abc
from collections.abc import Callable, Iterable, Iterator
from numbers import Integral, Real
from typing import Any, Literal, TypeVar, Union

import numpy as np
import torch
from torch import Tensor

from ndtorch.arguments import LARGEST, WITHIN
from ndtorch.errors import InputError

MOST_WHOLE = 2**63
"""Largest whole number that arrays hold."""

SEEN = "_explains_arguments"
"""Attribute of a call that is wrapped already."""

OF_ARRAYS = {"RuntimeError", "IndexError", "ValueError", "AssertionError", "TypingError"}
"""What PyTorch, NumPy and kernels raise for arrays whose shapes do not fit; no class derived from these."""

CHECKED_BY_THEMSELVES = (tuple, enum.Enum, BaseException)

Some = TypeVar("Some")


def explain_calls(package: str, names: Iterable[str]) -> None:
    """Wrap the public functions of a package, and the constructors and public methods of its classes."""
    module = sys.modules[package]
    for name in names:
        setattr(module, name, explained(getattr(module, name)))


def explained(thing: Some) -> Some:
    """A function that explains what is wrong with its arguments, or a class whose constructor and public methods do.

    A function is replaced in the module that defines it, so that it can be pickled. All else comes back as it is.
    """
    if inspect.isfunction(thing):
        checked = wrapped(thing, is_doubtful)
        setattr(sys.modules[thing.__module__], thing.__name__, checked)
        return checked  # type: ignore[return-value]
    if inspect.isclass(thing) and not issubclass(thing, CHECKED_BY_THEMSELVES) and not hasattr(thing, "model_fields"):
        for kind in thing.__mro__:
            if kind.__module__.partition(".")[0] == thing.__module__.partition(".")[0] and not is_protocol(kind):
                explain_class(kind)
    return thing


def is_protocol(kind: type) -> bool:
    return bool(getattr(kind, "_is_protocol", False))


def explain_class(kind: type) -> None:
    for name, member in list(vars(kind).items()):
        call = member.__func__ if isinstance(member, classmethod | staticmethod) else member
        if inspect.isfunction(call) and (name == "__init__" or not name.startswith("_")):
            checked = wrapped(call, is_plain if name == "__init__" else None)
            setattr(kind, name, checked if call is member else type(member)(checked))


def wrapped(call: Callable[..., Any], at_once: Callable[[object], bool] | None) -> Callable[..., Any]:
    """The same call; what `at_once` picks is compared with the annotations before it runs."""
    if hasattr(call, SEEN):
        return call

    @functools.wraps(call)
    def explaining(*args: Any, **given: Any) -> Any:
        if torch.compiler.is_compiling():
            return call(*args, **given)
        if at_once is not None and any(map(at_once, (*args, *given.values()))):
            complain(call, args, given, at_once)
        try:
            return call(*args, **given)
        except Exception as error:
            if not (isinstance(error, InputError) or documents(call, error)):
                complain(call, args, given, error=error)
            raise

    @functools.wraps(call)
    def iterating(*args: Any, **given: Any) -> Iterator[Any]:
        try:
            yield from call(*args, **given)
        except Exception as error:
            if not (isinstance(error, InputError) or documents(call, error)):
                complain(call, args, given, error=error)
            raise

    chosen = iterating if inspect.isgeneratorfunction(call) else explaining
    setattr(chosen, SEEN, True)
    return chosen


def documents(call: Callable[..., Any], error: Exception) -> bool:
    """Whether a call says itself that it raises this error."""
    return f"{type(error).__name__}:" in (call.__doc__ or "")


def is_argument(value: object) -> bool:
    return True


def is_plain(value: object) -> bool:
    """Whether a value is of Python, NumPy or PyTorch: objects of other classes may stand in for one another."""
    return type(value).__module__.partition(".")[0] in ("builtins", "numpy", "torch")


def is_doubtful(value: object) -> bool:
    """Whether a value passes for a number without being one."""
    return type(value) is bool or (type(value) is float and math.isnan(value))


def complain(
    call: Callable[..., Any],
    args: tuple[Any, ...],
    given: dict[str, Any],
    chosen: Callable[[object], bool] = is_argument,
    error: Exception | None = None,
) -> None:
    """Raise `InputError` for the first argument that is not as annotated; nothing where all are."""
    signature, hints = annotations_of(call)
    try:
        bound = signature.bind(*args, **given)
    except TypeError:  # says itself what is missing or unknown
        return
    for name, value in bound.arguments.items():
        place = signature.parameters[name]
        if place.kind in (place.VAR_POSITIONAL, place.VAR_KEYWORD) or not chosen(value):
            continue
        wanted = "" if fits(value, hints[name]) or value is place.default else in_words(hints[name])
        if not wanted and not is_usable(value):
            wanted = f"a number {WITHIN}"
        if wanted:
            raise InputError(f"{name} must be {wanted}, got {shown(value)}") from error
    arrays = {name: value for name, value in bound.arguments.items() if isinstance(value, Tensor | np.ndarray)}
    if arrays and type(error).__name__ in OF_ARRAYS and not re.search("alloc|memory", str(error)):
        got = ", ".join(f"{name} {list(value.shape)} {value.dtype}" for name, value in arrays.items())
        words = str(error).partition("\n")[0] or "they do not fit"
        raise InputError(f"{call.__name__} cannot take {got}: {words}") from error


@functools.cache
def annotations_of(call: Callable[..., Any]) -> tuple[inspect.Signature, dict[str, Any]]:
    signature = inspect.signature(call)
    return signature, {name: hint_of(call, place) for name, place in signature.parameters.items()}


def hint_of(call: Callable[..., Any], place: inspect.Parameter) -> Any:
    """The annotation of a parameter; `Any` where there is none, or one that only type checkers can read."""
    hint = Any if place.annotation is place.empty else place.annotation
    try:
        return eval(hint, dict(call.__globals__)) if isinstance(hint, str) else hint
    except (NameError, TypeError, AttributeError, SyntaxError):
        return Any


def is_usable(value: Any) -> bool:
    """Whether a number can be computed with, or is infinity, which some times and limits are; others always are."""
    if isinstance(value, Integral):
        return bool(abs(int(value)) <= MOST_WHOLE)
    return not isinstance(value, Real) or bool(abs(float(value)) <= LARGEST or value == math.inf)


def shown(value: object) -> str:
    """A value in an error message: plain ones as they are, others by their type."""
    plain = value is None or isinstance(value, Real | str | bytes | list | tuple | dict)
    return repr(value)[:40] if plain else type(value).__name__


def fits(value: Any, hint: Any) -> bool:
    """Whether a value is what an annotation asks for; True where nobody can say."""
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if hint in (None, types.NoneType):
        return value is None
    if origin in (Union, types.UnionType):
        return any(fits(value, part) for part in parts)
    if origin is Literal:
        return any(type(value) is type(part) and value == part for part in parts)
    if origin is typing.Annotated:
        return fits(value, parts[0])
    if hint is bool:
        return isinstance(value, bool | np.bool_)
    if hint is float or hint is int:
        return isinstance(value, Real if hint is float else Integral) and not isinstance(value, bool)
    if origin is tuple:
        return isinstance(value, tuple | list) and fits_all(value, parts)
    if origin in (list, abc.Sequence, abc.Iterable) and isinstance(value, list | tuple):
        return all(fits(part, parts[0]) for part in value)
    kind = hint if origin is None else origin
    if kind is Any or not isinstance(kind, type):
        return True
    if is_protocol(kind):
        return all(hasattr(value, name) for name in members(kind))
    return isinstance(value, kind) and not (isinstance(value, str | bytes) and origin in (abc.Sequence, abc.Iterable))


def members(protocol: type) -> set[str]:
    """What an object must have to follow a protocol."""
    own = {name for kind in protocol.__mro__ if is_protocol(kind) for name in (*vars(kind), *annotated(kind))}
    return {name for name in own if name == "__call__" or name[0] != "_"}


def annotated(kind: type) -> Iterable[str]:
    names: Iterable[str] = vars(kind).get("__annotations__", ())
    return names


def fits_all(values: tuple[Any, ...] | list[Any], hints: tuple[Any, ...]) -> bool:
    """Whether the parts of a tuple are as annotated."""
    if len(hints) == 2 and hints[1] is Ellipsis:
        return all(fits(value, hints[0]) for value in values)
    return len(values) == len(hints) and all(map(fits, values, hints))


def in_words(hint: Any) -> str:
    """What an annotation asks for."""
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if hint in (None, types.NoneType):
        return "None"
    if origin in (Union, types.UnionType):
        return " or ".join(map(in_words, parts))
    if origin is Literal:
        return " or ".join(map(repr, parts))
    if origin is tuple:
        return f"a tuple of {' and '.join('more' if part is Ellipsis else in_words(part) for part in parts)}"
    usual = {float: "a number", int: "a whole number", bool: "True or False", str: "text"}
    named = usual.get(hint) or str(getattr(origin or hint, "__name__", hint))
    return f"{named} of {in_words(parts[0])}" if origin in (list, abc.Sequence, abc.Iterable) else named
