"""What was tried, one line a change, so that a run that was broken off goes on where it was."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping
from pathlib import Path

HEADER = "number\toutcome\tplace\tkind\tchange"

UNASKED = "survived the mirrored file"
"""Outcome of what only the mirrored file was asked about: the wider list may notice it yet."""


class WrongTable(ValueError):
    """The table is of another sample."""


def sample_name(seed: int, texts: Mapping[str, str], without: Iterable[str]) -> str:
    """A name for the order in which the changes of these very sources are drawn."""
    digest = hashlib.sha256(repr((seed, sorted(texts.items()), list(without))).encode())
    return f"# seed {seed}, sources {digest.hexdigest()[:16]}"


class Table:
    """Outcomes by the number of the change in its sample; every line is kept as soon as it is known.

    Args:
        path: of the table. What it holds of the same sample is taken over.
        name: of the sample; see `sample_name`.

    Raises:
        WrongTable: it holds another sample.
    """

    def __init__(self, path: Path, name: str) -> None:
        self.path, self.name = path, name
        self.lines: dict[int, list[str]] = {}
        if path.is_file():
            first, *rest = path.read_text(encoding="utf-8").splitlines() or [name]
            if first != name:
                raise WrongTable(f"{path} holds another sample: take it away, or give another --out")
            for line in rest[1:]:
                number, *fields = line.split("\t")
                if len(fields) == 4:  # a line that was broken off is tried again
                    self.lines[int(number)] = fields
        path.parent.mkdir(parents=True, exist_ok=True)
        self.write()

    def write(self) -> None:
        """All of it, in order."""
        lines = ["\t".join([str(number), *fields]) for number, fields in sorted(self.lines.items())]
        part = self.path.with_suffix(".part")
        part.write_text("\n".join([self.name, HEADER, *lines]) + "\n", encoding="utf-8")
        part.replace(self.path)

    def outcome(self, number: int) -> str | None:
        """What is known of a change."""
        return self.lines[number][0] if number in self.lines else None

    def put(self, number: int, outcome: str, place: str, kind: str, shown: str) -> None:
        """One more is known."""
        self.lines[number] = [outcome, place, kind, shown.replace("\t", " ")]
        self.write()

    def counts(self) -> tuple[int, int]:
        """How many were noticed, and how many were tried."""
        tried = [outcome for outcome, *_ in self.lines.values() if outcome != "does not compile"]
        return sum(outcome.startswith("noticed") for outcome in tried), len(tried)


def interval(part: int, whole: int, z: float = 1.96) -> tuple[float, float]:
    """Wilson's 95 % interval of a share."""
    if not whole:
        return 0.0, 1.0
    share, spread = part / whole, z * z / whole
    middle = (share + spread / 2) / (1 + spread)
    half = z / (1 + spread) * math.sqrt(share * (1 - share) / whole + spread / (4 * whole))
    return max(0.0, middle - half), min(1.0, middle + half)
