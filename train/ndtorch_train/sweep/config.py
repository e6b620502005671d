"""What a sweep is, read from a TOML file, and the trials it consists of."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from ndtorch.errors import InputError
from ndtorch.utils.toml import Strict, check, suggestion, toml_values
from ndtorch_train.sweep.parameters import Parameter, Trial, Value, trial_id

Kind = Literal["binding", "driving"]

MOST = 1_000_000
"""Trials of one sweep at most: more is a mistake."""


class Show(Strict):
    """Table [show]: what to draw."""

    x: str | None = None
    y: str | None = None
    panels: str | None = None
    values: Annotated[tuple[str, ...], Field(min_length=1)] | None = None


class Span(Strict):
    """A range of values; `steps` of a grid."""

    low: float = Field(alias="from")
    high: float = Field(alias="to")
    steps: Annotated[int, Field(ge=0, le=1_000_000)] | None = None
    scale: Literal["linear", "log"] = "linear"


class SweepFile(Strict):
    """The contents of the file of a sweep."""

    kind: Kind = "binding"
    method: Literal["grid", "random"] = "grid"
    trials: Annotated[int, Field(ge=0)] = 0
    seed: int = 0
    device: str = "cpu"
    vary: dict[str, Any] = Field(default_factory=dict)
    fixed: dict[str, Any] = Field(default_factory=dict)
    show: Show = Show()


@dataclass(frozen=True)
class SweepConfig:
    """A sweep.

    Attributes:
        name: of the file, without `.toml`.
        kind: "binding" or "driving".
        trials: every trial with all its parameters.
        varied: names of the parameters that vary.
        device: where binding trials are computed.
        show: parameter along x, along y, and from panel to panel ("" for one panel), and the results to draw.
    """

    name: str
    kind: Kind
    trials: list[Trial]
    varied: tuple[str, ...]
    device: str
    show: tuple[str, str, str, tuple[str, ...]]


def module_of(kind: str) -> ModuleType:
    """What runs the trials of that kind, with their parameters and the results that are numbers."""
    from ndtorch_train.sweep import binding, driving

    return binding if kind == "binding" else driving


def read_sweep(path: Path) -> SweepConfig:
    """Read a sweep."""
    return parse(toml_values(path), str(path), path.stem)


def parse(data: Mapping[str, Any], where: str, name: str) -> SweepConfig:
    """A sweep from plain data; errors as `read_sweep`."""
    file = check(data, SweepFile, where)
    module = module_of(file.kind)
    parameters: Mapping[str, Parameter] = module.PARAMETERS
    for key in (*file.vary, *file.fixed):
        if key not in parameters:
            raise InputError(f"{where}: unknown key {key!r}; {suggestion(key, parameters)}")
    twice = sorted(set(file.vary) & set(file.fixed))
    if twice:
        raise InputError(f"{where}: {twice[0]} is both in [vary] and in [fixed]")
    base: Trial = {key: p.default for key, p in parameters.items()}
    base |= {key: parameters[key].check(key, value, where) for key, value in file.fixed.items()}
    choices = {key: spec if isinstance(spec, list) else span(key, spec, where) for key, spec in file.vary.items()}
    if file.method == "grid":
        axes = {key: grid_values(key, spec, parameters[key], where) for key, spec in choices.items()}
        count = math.prod(len(values) for values in axes.values()) if axes else 0
    else:
        count = file.trials if all(choices.values()) else 0
    if count == 0 or not file.vary:
        missing = "an empty list in [vary]" if file.vary else "nothing in [vary]"
        if file.method == "random" and not file.trials:
            missing = "trials = 0"
        raise InputError(f"{where}: this sweep has no trial ({missing})")
    if count > MOST:
        raise InputError(f"{where}: {count} trials; at most {MOST}")
    if file.method == "grid":
        found = [base | dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]
    else:
        rng = np.random.default_rng(file.seed)
        found = [
            base | {key: drawn(key, spec, parameters[key], rng, where) for key, spec in choices.items()}
            for _ in range(count)
        ]
    unique = {trial_id(trial): trial for trial in found}
    show = shown(file.show, tuple(file.vary), module.RESULTS, where)
    return SweepConfig(name, file.kind, list(unique.values()), tuple(file.vary), file.device, show)


def span(name: str, spec: Any, where: str) -> Span:
    """A range of a parameter."""
    if not isinstance(spec, dict):
        raise InputError(f"{where}: {name} must be a list or {{ from = .., to = .., steps = .. }}, got {spec!r}")
    found = check(spec, Span, f"{where}: {name}")
    if found.scale == "log" and not (found.low > 0 and found.high > 0):
        raise InputError(
            f"{where}: {name} must be positive on a logarithmic scale, got {found.low:g} to {found.high:g}"
        )
    return found


def grid_values(name: str, spec: list[Any] | Span, parameter: Parameter, where: str) -> list[Value]:
    """Values of a parameter on a grid, from a list or a range."""
    if isinstance(spec, list):
        return [parameter.check(name, value, where) for value in spec]
    if spec.steps is None:
        raise InputError(f"{where}: {name} needs steps, a whole number")
    spaced = np.geomspace if spec.scale == "log" else np.linspace
    # Rounded, so that 0.1 is 0.1 in names of trials and on axes.
    return [parameter.check(name, float(f"{value:.9g}"), where) for value in spaced(spec.low, spec.high, spec.steps)]


def drawn(name: str, spec: list[Any] | Span, parameter: Parameter, rng: np.random.Generator, where: str) -> Value:
    """One random value of a parameter."""
    if isinstance(spec, list):
        return parameter.check(name, spec[int(rng.integers(len(spec)))], where)
    if isinstance(parameter.default, int):
        return parameter.check(name, int(rng.integers(math.ceil(spec.low), math.floor(spec.high) + 1)), where)
    if spec.scale == "log":
        return parameter.check(name, math.exp(rng.uniform(math.log(spec.low), math.log(spec.high))), where)
    return parameter.check(name, float(rng.uniform(spec.low, spec.high)), where)


def shown(
    show: Show, varied: tuple[str, ...], results: tuple[str, ...], where: str
) -> tuple[str, str, str, tuple[str, ...]]:
    """What to draw; by default the first two varied parameters and a panel for each value of the third."""
    rest = [*varied, "", "", ""]
    x = rest[0] if show.x is None else show.x
    y = rest[1] if show.y is None else show.y
    panels = (rest[2] if show.x is None else "") if show.panels is None else show.panels
    for key in (x, y, panels):
        if key and key not in varied:
            raise InputError(f"{where}: [show] names {key!r}, which does not vary; {', '.join(varied)} do")
    values = show.values or results[:1]
    if not set(values) <= set(results):
        raise InputError(f"{where}: [show] values must be some of {', '.join(results)}, got {list(values)!r}")
    return x, y, panels, values
