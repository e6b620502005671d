"""What a claim is, and what came out when it was tried."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

Verdict = Literal["holds", "partly", "does not hold", "not run in quick"]
"""Whether a claim stood the test; the last is for claims that take too long for a quick look."""


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


@dataclass(frozen=True)
class Drawing:
    """A figure of an experiment.

    Attributes:
        name: of its files, without `.svg` and `.png`.
        title: which figure of which paper it is drawn after.
        caption: what it shows.
        parameters: what it was computed with.
    """

    name: str
    title: str
    caption: str
    parameters: dict[str, Any]


def with_better(claims: Sequence[Claim]) -> list[Claim]:
    """The claims, and behind each the same with better parts, where there are any."""
    return [one for claim in claims for one in (claim, claim.better) if one is not None]


def verdict_of(*parts: bool) -> Verdict:
    """All parts of a claim hold, some do, or none."""
    if all(parts):
        return "holds"
    return "partly" if any(parts) else "does not hold"
