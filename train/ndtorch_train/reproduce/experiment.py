"""Claims and outcomes, the folder in which experiments work, and the results they keep there."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Arrays = dict[str, npt.NDArray[Any]]

DPI = 110

Verdict = Literal["holds", "partly", "does not hold", "not run in quick"]
"""Whether a claim passed; the last is for claims that have no quick form."""


@dataclass(frozen=True)
class Outcome:
    """The result of one experiment.

    Attributes:
        ours: our value, in words as short as the printed one.
        verdict: whether it lies within the claim's tolerance.
        why: one line of reasons.
        numbers: everything measured, fit for JSON.
    """

    ours: str
    verdict: Verdict
    why: str
    numbers: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Claim:
    """A published result and the experiment that tries it.

    Attributes:
        id: A1 to A9, B1 to B9 and C1 to C9.
        source: where it is printed.
        text: the claim.
        printed: the printed value, or what the figure shows.
        tolerance: what counts as reproduced.
        run: the experiment, `run(context, **parameters)`.
        full: its parameters.
        quick: those of `--quick`; None where there is no quick form.
        seconds: on one core in the full form; long ones start first.
    """

    id: str
    source: str
    text: str
    printed: str
    tolerance: str
    run: Callable[..., Outcome]
    full: Mapping[str, Any]
    quick: Mapping[str, Any] | None
    seconds: float


class Context:
    """The folder of one experiment.

    Attributes:
        quick: shorter or fewer trials.
        drawings: figures so far: name of the files without `.svg` and `.png`, title (the figure of the paper), caption
            and parameters.
    """

    def __init__(self, folder: Path, store: Path, quick: bool) -> None:
        self.folder, self.store, self.quick = folder, store, quick
        self.drawings: list[dict[str, Any]] = []

    def draw(self, name: str, figure: Figure, title: str, caption: str, first: str = "a", **parameters: Any) -> None:
        """Write a figure as SVG and PNG; its panels get letters from `first` on."""
        import matplotlib

        from ndtorch_train.plots import letters

        letters(figure, first)
        if self.quick:
            caption = f"{caption} Quick run: fewer or shorter trials."
        with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": name}):
            figure.savefig(self.folder / f"{name}.svg", dpi=DPI, metadata={"Date": None})
        figure.savefig(self.folder / f"{name}.png", dpi=DPI)
        self.drawings.append({"name": name, "title": title, "caption": caption, "parameters": parameters})

    def stored(self, kind: str, key: Mapping[str, Any], make: Callable[[], Arrays]) -> Arrays:
        """Arrays that several experiments share, computed once; `key` names the parameters they depend on."""
        path = self.store / f"{kind}-{digest(key)}.npz"
        if not path.exists():
            beside = self.store / f"{path.stem}.{os.getpid()}.npz"
            np.savez(beside, **make())  # type: ignore[arg-type]
            beside.replace(path)
        with np.load(path) as arrays:
            return dict(arrays)


def digest(value: Any) -> str:
    """Twelve hexadecimal digits of a JSON value and of the versions of the package and of torch."""
    text = json.dumps([value, version("ndtorch"), version("torch")], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def judged(context: Context, ours: str, why: str, parts: Mapping[str, bool], numbers: dict[str, Any]) -> Outcome:
    """An outcome from the parts of a claim, each true or false; `why` gets those that fail."""
    failed = [name for name, good in parts.items() if not good]
    if failed:
        why = f"{why} Not met: {'; '.join(failed)}."
    if context.quick:
        why = f"[quick] {why}"
    verdict: Verdict = "holds" if not failed else "partly" if len(failed) < len(parts) else "does not hold"
    return Outcome(ours, verdict, why.strip(), {**numbers, "criteria": dict(parts)})


@dataclass(frozen=True)
class Entry:
    """A claim with its outcome, parameters, figures and the folder of the figures."""

    claim: Claim
    outcome: Outcome
    parameters: Mapping[str, Any]
    drawings: list[dict[str, Any]]
    folder: Path


def result_folder(claim: Claim, quick: bool, out: Path) -> Path:
    """The folder of a claim's result for these parameters and this version of the package."""
    return out / "results" / f"{claim.id}-{digest([claim.quick if quick else claim.full])}"


def load_result(claim: Claim, quick: bool, out: Path) -> Entry | None:
    """The kept result of a claim; None if there is none."""
    if quick and claim.quick is None:
        return Entry(claim, Outcome("-", "not run in quick", "Takes too long for --quick."), {}, [], out)
    folder = result_folder(claim, quick, out)
    if not (folder / "result.json").is_file():
        return None
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    return Entry(claim, Outcome(**result["outcome"]), result["parameters"], result["drawings"], folder)


def run_claim(claim: Claim, quick: bool, out: Path) -> None:
    """Run one experiment; its folder gets its final name when everything is written."""
    place, store = result_folder(claim, quick, out), out / "data"
    work = place.with_name(f"{place.name}.part")
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    store.mkdir(exist_ok=True)
    parameters = dict(claim.quick if quick and claim.quick is not None else claim.full)
    context = Context(work, store, quick)
    outcome = claim.run(context, **parameters)
    result = {"parameters": parameters, "outcome": asdict(outcome), "drawings": context.drawings}
    text = json.dumps(result, indent=1, default=lambda array: array.tolist())
    (work / "result.json").write_text(text + "\n", encoding="utf-8")
    shutil.rmtree(place, ignore_errors=True)
    work.rename(place)
