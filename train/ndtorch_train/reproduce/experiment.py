"""What a claim and its outcome are, where experiments work, and the cache of their results."""

from __future__ import annotations

import hashlib
import json
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy.typing as npt

from ndtorch.errors import InputError
from ndtorch.utils.files import TABLE_BYTES, hold, load_arrays, read_text, save_arrays
from ndtorch.utils.packages import code_digest
from ndtorch.utils.workers import Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Arrays = dict[str, npt.NDArray[Any]]

DPI = 110

Verdict = Literal["holds", "partly", "does not hold", "not run in quick"]
"""Whether a claim passed; the last is for claims that take too long for a quick look."""


@dataclass(frozen=True)
class Outcome:
    """What one experiment found.

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
        id: A1 to A9, B1 to B9 and C1 to C9 as in the table of claims; B10 is a sentence of [B §3.4.1].
        source: where it is printed.
        text: what is claimed.
        printed: the printed value, or what the figure shows.
        tolerance: what counts as reproduced.
        run: the experiment, `run(context, **parameters)`.
        full: its parameters.
        quick: those of `--quick`; None where there is no quick form.
        seconds: how long it takes on one core, full and quick, to order the work and guess the time left.
        uses: modules and packages whose code the result depends on, as `ndtorch.utils.packages` takes them.
        better: the same claim, source and tolerance, tried with parts that came later; its name ends in +. None where
            the claim holds as published, or where there are none.
        parts: which parts those are; empty for the published ones.
    """

    id: str
    source: str
    text: str
    printed: str
    tolerance: str
    run: Callable[..., Outcome]
    full: Mapping[str, Any]
    quick: Mapping[str, Any] | None
    seconds: tuple[float, float]
    uses: tuple[str, ...]
    better: Claim | None = None
    parts: str = ""

    def parameters(self, quick: bool) -> Mapping[str, Any] | None:
        """The parameters of that kind of run."""
        return self.quick if quick else self.full


def with_better(claims: Sequence[Claim]) -> list[Claim]:
    """The claims, and behind each the same with better parts, where there are any."""
    return [one for claim in claims for one in (claim, claim.better) if one is not None]


def verdict_of(*parts: bool) -> Verdict:
    """All parts of a claim hold, some do, or none."""
    if all(parts):
        return "holds"
    return "partly" if any(parts) else "does not hold"


def digest(value: Any) -> str:
    """Twelve hexadecimal digits of anything that JSON can hold."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()[:12]


def code_of(uses: Sequence[str]) -> str:
    """Twelve hexadecimal digits of the code of those modules, and of the version of torch."""
    return code_digest(tuple(uses))[:12]


class Context:
    """One experiment's workplace.

    Attributes:
        quick: whether shorter or fewer trials are wanted.
        drawings: figures made so far: name of the files without `.svg` and `.png`, title (the figure of a paper that it
            is drawn after), caption, and the parameters they were computed with.
    """

    def __init__(self, folder: Path, store: Path, quick: bool, report: Report) -> None:
        self.folder, self.store, self.quick = folder, store, quick
        self._report = report
        self.drawings: list[dict[str, Any]] = []

    def report(self, share: float) -> None:
        """Tell how much of the experiment is done, 0..1."""
        self._report(share)

    def draw(self, name: str, figure: Figure, title: str, caption: str, first: str = "a", **parameters: Any) -> None:
        """Keep a figure as SVG and PNG; its panels get letters from `first` on."""
        import matplotlib

        from ndtorch_train.plots import letters

        letters(figure, first)
        if self.quick:
            caption = f"{caption} Quick run: fewer or shorter trials."
        with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": name}):
            figure.savefig(self.folder / f"{name}.svg", dpi=DPI, metadata={"Date": None})
        figure.savefig(self.folder / f"{name}.png", dpi=DPI)
        self.drawings.append({"name": name, "title": title, "caption": caption, "parameters": parameters})

    def stored(self, kind: str, key: Mapping[str, Any], uses: Sequence[str], make: Callable[[], Arrays]) -> Arrays:
        """Arrays by what they were made with, computed once for all experiments and runs.

        Args:
            kind: what they are.
            key: parameters they depend on.
            uses: modules and packages they depend on.
            make: computes them.
        """
        begin = f"{kind}-{digest(key)}"
        path = self.store / f"{begin}-{code_of(uses)}.npz"
        with locked(self.store / f"{begin}.lock"):
            if path.exists():
                try:
                    return load_arrays(path)
                except InputError as error:
                    print(f"note: computed again, since {error}", file=sys.stderr)
            arrays = make()
            for old in self.store.glob(f"{begin}-*.npz"):
                old.unlink()
            save_arrays(path, arrays)
            return arrays


def judged(context: Context, ours: str, why: str, parts: Mapping[str, bool], numbers: dict[str, Any]) -> Outcome:
    """An outcome from the parts of a claim, each true or false; what fails is named in `why`."""
    failed = [name for name, good in parts.items() if not good]
    if failed:
        why = f"{why} Not met: {'; '.join(failed)}." if why else f"Not met: {'; '.join(failed)}."
    if context.quick:
        why = f"[quick] {why}"
    return Outcome(ours, verdict_of(*parts.values()), why.strip(), {**numbers, "criteria": dict(parts)})


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Only one process at a time; a process that dies lets go."""

    def note() -> None:
        print(f"note: waits for another run, which holds {path}", file=sys.stderr, flush=True)

    with path.open("w") as file:
        hold(file, note)
        yield


class ResultCache:
    """Results of claims in a folder, by claim and parameters; each knows the code that made it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def place(self, claim: Claim, quick: bool) -> Path:
        """Folder of the result."""
        return self.folder / f"{claim.id}-{digest([claim.parameters(quick), quick])}"

    def load(self, claim: Claim, quick: bool) -> tuple[dict[str, Any] | None, bool]:
        """The result, None if there is none that counts, and whether there is one from other code."""
        place = self.place(claim, quick)
        try:
            result = json.loads(read_text(place / "result.json", TABLE_BYTES))
            files = [place / f"{d['name']}.{kind}" for d in result["drawings"] for kind in ("svg", "png")]
            complete = all(file.is_file() for file in files)
            result["outcome"] = Outcome(**result["outcome"])
        except (OSError, ValueError, KeyError, TypeError):
            return None, False
        if result["code"] != code_of(claim.uses):
            return None, True
        return (result, False) if complete else (None, False)


def run_claim(claim: Claim, quick: bool, cache_folder: Path, code: str, report: Report) -> None:
    """Run one experiment and keep its result in the cache, one run of a claim after the other.

    A run that is killed leaves a folder `.part`, which the next one removes.

    Args:
        code: fingerprint of the code from before it was imported: files may change while a run goes on.
    """
    place, store = ResultCache(cache_folder).place(claim, quick), cache_folder / "data"
    work = place.with_name(f"{place.name}.part")
    store.mkdir(parents=True, exist_ok=True)
    parameters = claim.parameters(quick)
    assert parameters is not None
    with locked(store / f"{place.name}.lock"):
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir()
        context = Context(work, store, quick, report)
        outcome = claim.run(context, **parameters)
        result = {
            "id": claim.id,
            "code": code,
            "parameters": dict(parameters),
            "outcome": asdict(outcome),
            "drawings": context.drawings,
        }
        (work / "result.json").write_text(json.dumps(result, indent=1, default=plain) + "\n", encoding="utf-8")
        shutil.rmtree(place, ignore_errors=True)
        work.rename(place)


def plain(value: Any) -> Any:
    """Numbers and arrays of NumPy and torch as JSON has them."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} does not go into JSON")
