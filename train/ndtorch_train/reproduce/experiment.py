"""Claims and outcomes, figures, and arrays that experiments share."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Arrays = dict[str, npt.NDArray[Any]]


class Outcome(NamedTuple):
    """The result of one experiment.

    Attributes:
        ours: our value, in words as short as the printed one.
        why: one line of reasons.
        criteria: the parts of the claim, each met or not.
        numbers: everything measured; arrays and tensors become lists.
    """

    ours: str
    why: str
    criteria: Mapping[str, bool]
    numbers: Mapping[str, Any] = {}

    @property
    def verdict(self) -> str:
        """Whether the claim holds, partly holds or does not hold."""
        met = sum(self.criteria.values())
        return "holds" if met == len(self.criteria) else "partly" if met else "does not hold"

    @property
    def reasons(self) -> str:
        """Why, and the criteria that were not met."""
        failed = "; ".join(name for name, met in self.criteria.items() if not met)
        return f"{self.why} Not met: {failed}.".strip() if failed else self.why


class Claim(NamedTuple):
    """A published result and the experiment that tries it.

    Attributes:
        id: letter of the paper and number.
        source: where it is printed.
        text: the claim.
        printed: the printed value, or what the figure shows.
        tolerance: what counts as reproduced.
        run: the experiment, `run(context, **options)`.
        quick: options of `--quick`; None where there is no quick form.
    """

    id: str
    source: str
    text: str
    printed: str
    tolerance: str
    run: Callable[..., Outcome]
    quick: Mapping[str, Any] | None = None


class Context:
    """The folder in which an experiment works.

    Attributes:
        figures: so far: name of the files, title (the figure of the paper) and caption.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.figures: list[tuple[str, str, str]] = []

    def draw(self, name: str, figure: Figure, title: str, caption: str, first: str = "a") -> None:
        """Write a figure into `figures/` as SVG and PNG; several panels get letters from `first` on."""
        import matplotlib

        axes = [one for one in figure.axes if one.get_label() != "<colorbar>"]
        for n, one in enumerate(axes if len(axes) > 1 else (), ord(first)):
            one.set_title(f"({chr(n)}) {one.get_title()}", fontsize=10, loc="left")
            one.set_title("")
        (self.folder / "figures").mkdir(exist_ok=True)
        with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": name}):
            figure.savefig(self.folder / "figures" / f"{name}.svg", dpi=110, metadata={"Date": None})
        figure.savefig(self.folder / "figures" / f"{name}.png", dpi=110)
        self.figures.append((name, title, caption))

    def stored(self, kind: str, key: Mapping[str, Any], make: Callable[[], Arrays]) -> Arrays:
        """Arrays that several experiments share, computed once; `key` names the parameters they depend on."""
        text = json.dumps([key, version("ndtorch"), version("torch")], sort_keys=True, default=str)
        path = self.folder / "data" / f"{kind}-{hashlib.sha256(text.encode()).hexdigest()[:12]}.npz"
        if not path.exists():
            path.parent.mkdir(exist_ok=True)
            beside = path.with_name(f"{path.stem}.{os.getpid()}.npz")
            np.savez(beside, **make())  # type: ignore[arg-type]
            beside.replace(path)
        with np.load(path) as arrays:
            return dict(arrays)
