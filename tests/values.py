"""What a computation gives, in a table of few numbers a tensor: a change of any of them is seen.

A property says what must hold, and many a wrong number holds it. These tables say what came out when they were written,
for inputs that are drawn by a seed. They do not say that it is right: after a change that is meant,
`python -m tests.NAME` writes the table of that file anew, and its difference is part of the change.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tests.properties import samples, trial

Scene = Callable[[], Any]


def plain(thing: Any, name: str = "") -> dict[str, Tensor | str]:
    """Numbers and words of nested tuples, dictionaries, arrays and objects, by dotted names."""
    if thing is None:
        return {}
    if isinstance(thing, Tensor):
        return {name: thing.detach()}
    if isinstance(thing, np.ndarray | np.generic):
        return {name: torch.as_tensor(np.array(thing))}
    if isinstance(thing, bool | int | float):
        return {name: torch.tensor(thing, dtype=torch.float64)}
    if isinstance(thing, str):
        return {name: thing}
    if isinstance(thing, tuple | list | deque) and (table := regular(thing)) is not None:
        return {name: table}
    if isinstance(thing, Mapping):
        items = [(str(key), value) for key, value in thing.items()]
    elif hasattr(thing, "_fields"):
        items = list(zip(thing._fields, thing, strict=True))
    elif isinstance(thing, tuple | list | deque):
        items = [(str(n), part) for n, part in enumerate(thing)] + [("len", len(thing))]
    elif dataclasses.is_dataclass(thing):
        items = [(field.name, getattr(thing, field.name)) for field in dataclasses.fields(thing)]
    else:
        items = [
            (key, value) for key, value in vars(thing).items() if not dataclasses.is_dataclass(value)
        ]  # no constants
    found: dict[str, Tensor | str] = {}
    for key, value in items:
        found |= plain(value, f"{name}.{key}" if name else key)
    return found


def regular(thing: Any) -> Tensor | None:
    """Numbers in lists of lists that are all as long as the others."""
    try:
        table = np.array(thing)
    except (ValueError, TypeError, RuntimeError):
        return None
    return torch.as_tensor(table) if table.dtype.kind in "biuf" and not holds_arrays(thing) else None


def holds_arrays(thing: Any) -> bool:
    return isinstance(thing, Tensor | np.ndarray) or (
        isinstance(thing, tuple | list | deque) and any(holds_arrays(part) for part in thing)
    )


def summed(value: Tensor | str) -> str:
    """A number; of several their shape, the root of the mean square, and two sums with a weight for every place."""
    if isinstance(value, str):
        return repr(value)
    if value.ndim == 0:
        return f"{float(value):.7g}"
    flat = value.to(torch.float64).flatten()
    odd = int((~flat.isfinite()).sum())
    flat = flat.nan_to_num(0.0, 0.0, 0.0)
    size = max(1, len(flat))
    place = torch.arange(len(flat), dtype=torch.float64)
    power = math.sqrt(float(flat.square().sum()) / size)
    sums = [float((flat * (place * step + 1).sin()).sum()) / math.sqrt(size) for step in (0.9, 2.3)]
    shape = "x".join(map(str, value.shape))
    return " ".join(
        [shape, *(f"{0.0 if abs(v) < 1e-12 else v:.6g}" for v in (power, *sums))] + [f"odd {odd}"] * (odd > 0)
    )


def rows_of(made: Any) -> dict[str, str]:
    return {name: summed(value) for name, value in plain(made).items()}


def differs(found: str, wanted: str, tolerance: float) -> bool:
    """Whether two rows are more apart than rounding: a share of the root of the mean square."""
    a, b = found.split(), wanted.split()
    if found == wanted or found[:1] in ("'", '"') or wanted[:1] in ("'", '"') or len(a) != len(b):
        return found != wanted
    if len(a) == 1:
        return not math.isclose(float(found), float(wanted), rel_tol=tolerance, abs_tol=1e-9)
    if a[0] != b[0] or a[4:] != b[4:]:
        return True
    one, other = ([float(word) for word in words[1:4]] for words in (a, b))
    return any(abs(x - y) > tolerance * max(one[0], other[0]) + 1e-9 for x, y in zip(one, other, strict=True))


def read(table: Path) -> dict[str, dict[str, str]]:
    """Rows by scene and name."""
    found: dict[str, dict[str, str]] = {}
    for line in table.read_text(encoding="utf-8").splitlines():
        scene, name, row = line.split("\t")
        found.setdefault(scene, {})[name] = row
    return found


def write(table: Path, scenes: Mapping[str, Scene]) -> None:
    """All scenes anew."""
    with torch.no_grad():
        lines = [f"{scene}\t{name}\t{row}" for scene in scenes for name, row in rows_of(scenes[scene]()).items()]
    table.write_text("\n".join(lines) + "\n", encoding="utf-8")


def compare(table: Path, scene: str, make: Scene, tolerance: float = 1e-4) -> None:
    """Fails with the first rows that are others; what is not in the table yet is passed over."""
    with torch.no_grad():
        found, wanted = rows_of(make()), read(table)[scene]
    missing = [name for name in wanted if name not in found]
    assert not missing, f"there is no {missing[:5]} any more"
    others = [
        f"{name}: {found[name]}, not {row}" for name, row in wanted.items() if differs(found[name], row, tolerance)
    ]
    assert not others, f"{len(others)} of {len(found)}: " + "; ".join(others[:5])


def of_parts(parts: Mapping[str, Any], package: str, kinds: tuple[str, ...] = ("noise", "edges")) -> dict[str, Scene]:
    """Two trials of every public module of a package, and its state after them."""

    def run(part: Any, kind: str) -> Any:
        chance = torch.Generator().manual_seed(7)
        streams = part.given(lambda *shape: samples((2, 8, *shape), kind, chance))
        return part.run(streams if part.batched else trial(streams, 0))

    return {
        f"{name}, {kind}": partial(run, part, kind)
        for name, part in parts.items()
        if type(part.make()).__module__.startswith(package)
        for kind in kinds
    }


def main(file: str, scenes: Mapping[str, Scene]) -> None:
    """`python -m tests.NAME`."""
    write(table_of(file), scenes)


def table_of(file: str) -> Path:
    """Beside a file of tests: `values_NAME.txt`."""
    path = Path(file)
    return path.with_name(path.stem.removeprefix("test_") + ".txt")
