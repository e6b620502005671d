"""One small change of the source."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Change:
    """Replace `text[start:end]` of a file by `new`.

    Attributes:
        file: path from the root of the checkout.
        line: 1 for the first.
        kind: what sort of change.
    """

    file: str
    line: int
    start: int
    end: int
    new: str
    kind: str

    def applied(self, text: str) -> str:
        return text[: self.start] + self.new + text[self.end :]

    def shown(self, text: str) -> str:
        """The line before and after, in one line."""
        first = text.rfind("\n", 0, self.start) + 1
        last = text.find("\n", self.end)
        last = len(text) if last < 0 else last
        old, new = text[first:last], text[first : self.start] + self.new + text[self.end : last]
        return f"{' '.join(old.split())}  ->  {' '.join(new.split())}"
