"""What a sweep is, read from a TOML file, and the trials it consists of."""

from __future__ import annotations

import difflib
import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ndtorch.errors import InputError
from ndtorch.toml import toml_values
from ndtorch_train.sweep.parameters import Parameter, Trial, Value, trial_id

Kind = Literal["binding", "driving"]

TOP = ("kind", "method", "trials", "seed", "device", "vary", "fixed", "show")
RANGE = ("from", "to", "steps", "scale")
MOST = 1_000_000
"""Trials of one sweep at most: more is a mistake."""


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


def parameters_of(kind: str) -> Mapping[str, Parameter]:
    """Parameters of the trials of that kind."""
    from ndtorch_train.sweep import binding, driving

    return binding.PARAMETERS if kind == "binding" else driving.PARAMETERS


def results_of(kind: str) -> tuple[str, ...]:
    """Names of the results of that kind that are numbers."""
    from ndtorch_train.sweep import binding, driving

    return binding.RESULTS if kind == "binding" else driving.RESULTS


def read_sweep(path: Path) -> SweepConfig:
    """Read a sweep.

    Raises:
        InputError: a file that cannot be read, an unknown key (with the nearest known one), a value out of range,
            or a sweep without a trial.
    """
    return parse(toml_values(path), str(path), path.stem)


def parse(data: Mapping[str, Any], where: str, name: str) -> SweepConfig:
    """A sweep from plain data; errors as `read_sweep`."""
    known_keys(data, TOP, where)
    kind = data.get("kind", "binding")
    if kind not in ("binding", "driving"):
        raise InputError(f"{where}: kind must be binding or driving, got {kind!r}")
    method = data.get("method", "grid")
    if method not in ("grid", "random"):
        raise InputError(f"{where}: method must be grid or random, got {method!r}")
    parameters = parameters_of(kind)
    vary, fixed = table(data, "vary", where), table(data, "fixed", where)
    for part in (vary, fixed):
        known_keys(part, parameters, where)
    twice = sorted(set(vary) & set(fixed))
    if twice:
        raise InputError(f"{where}: {twice[0]} is both in [vary] and in [fixed]")
    base: Trial = {key: p.default for key, p in parameters.items()}
    base |= {key: parameters[key].check(key, value, where) for key, value in fixed.items()}
    if method == "grid":
        axes = {key: grid_values(key, spec, parameters[key], where) for key, spec in vary.items()}
        count = math.prod(len(values) for values in axes.values()) if axes else 0
    else:
        count = data.get("trials", 0)
        if isinstance(count, bool) or not isinstance(count, int) or count < 0:
            raise InputError(f"{where}: trials must be a whole number, got {count!r}")
    if count == 0 or not vary:
        missing = "an empty list in [vary]" if vary else "nothing in [vary]"
        raise InputError(f"{where}: this sweep has no trial ({'trials = 0' if method == 'random' else missing})")
    if count > MOST:
        raise InputError(f"{where}: {count} trials; at most {MOST}")
    if method == "grid":
        found = [base | dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]
    else:
        rng = np.random.default_rng(int(data.get("seed", 0)))
        found = [
            base | {key: drawn(key, spec, parameters[key], rng, where) for key, spec in vary.items()}
            for _ in range(count)
        ]
    unique = {trial_id(trial): trial for trial in found}
    show = read_show(table(data, "show", where), tuple(vary), results_of(kind), where)
    return SweepConfig(name, kind, list(unique.values()), tuple(vary), str(data.get("device", "cpu")), show)


def known_keys(data: Mapping[str, Any], known: Any, where: str) -> None:
    """Raise `InputError` for the first unknown key, naming the nearest known one."""
    for key in data:
        if key not in known:
            near = difflib.get_close_matches(key, known, 1, 0.4)
            hint = f", did you mean {near[0]!r}?" if near else ""
            raise InputError(f"{where}: unknown key {key!r}{hint} Known: {', '.join(known)}")


def table(data: Mapping[str, Any], key: str, where: str) -> dict[str, Any]:
    """A table of the file, empty where it is missing."""
    value = data.get(key, {})
    if not isinstance(value, dict):
        raise InputError(f"{where}: {key} must be a table, got {value!r}")
    return value


def span(name: str, spec: Mapping[str, Any], where: str) -> tuple[float, float, bool]:
    """Ends of a range, and whether it is logarithmic."""
    known_keys(spec, RANGE, f"{where}: {name}")
    try:
        low, high, log = float(spec["from"]), float(spec["to"]), spec.get("scale", "linear") == "log"
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{where}: {name} must be a list or {{ from = .., to = .., steps = .. }}") from None
    if log and not (low > 0 and high > 0):
        raise InputError(f"{where}: {name} must be positive on a logarithmic scale, got {low:g} to {high:g}")
    return low, high, log


def grid_values(name: str, spec: Any, parameter: Parameter, where: str) -> list[Value]:
    """Values of a parameter on a grid, from a list or from `from`, `to`, `steps`."""
    if isinstance(spec, list):
        return [parameter.check(name, value, where) for value in spec]
    if not isinstance(spec, dict):
        raise InputError(f"{where}: {name} must be a list or {{ from = .., to = .., steps = .. }}, got {spec!r}")
    low, high, log = span(name, spec, where)
    steps = spec.get("steps")
    if isinstance(steps, bool) or not isinstance(steps, int) or steps < 0:
        raise InputError(f"{where}: {name} needs steps, a whole number, got {steps!r}")
    values = np.geomspace(low, high, steps) if log else np.linspace(low, high, steps)
    # Rounded, so that 0.1 is 0.1 in names of trials and on axes.
    return [parameter.check(name, float(f"{value:.9g}"), where) for value in values]


def drawn(name: str, spec: Any, parameter: Parameter, rng: np.random.Generator, where: str) -> Value:
    """One random value of a parameter."""
    if isinstance(spec, list):
        if not spec:
            raise InputError(f"{where}: this sweep has no trial ({name} is an empty list)")
        return parameter.check(name, spec[int(rng.integers(len(spec)))], where)
    if not isinstance(spec, dict):
        raise InputError(f"{where}: {name} must be a list or {{ from = .., to = .. }}, got {spec!r}")
    low, high, log = span(name, spec, where)
    if isinstance(parameter.default, int):
        return parameter.check(name, int(rng.integers(math.ceil(low), math.floor(high) + 1)), where)
    value = math.exp(rng.uniform(math.log(low), math.log(high))) if log else float(rng.uniform(low, high))
    return parameter.check(name, value, where)


def read_show(
    spec: dict[str, Any], varied: tuple[str, ...], results: tuple[str, ...], where: str
) -> tuple[str, str, str, tuple[str, ...]]:
    """What to draw; by default the first two varied parameters and a panel for each value of the third."""
    known_keys(spec, ("x", "y", "panels", "values"), f"{where}: [show]")
    rest = [*varied, "", "", ""]
    x, y = str(spec.get("x", rest[0])), str(spec.get("y", rest[1]))
    panels = str(spec.get("panels", rest[2] if "x" not in spec else ""))
    for key in (x, y, panels):
        if key and key not in varied:
            raise InputError(f"{where}: [show] names {key!r}, which does not vary; {', '.join(varied)} do")
    values = spec.get("values", [results[0]])
    if not isinstance(values, list) or not values or not set(values) <= set(results):
        raise InputError(f"{where}: [show] values must be some of {', '.join(results)}, got {values!r}")
    return x, y, panels, tuple(values)
