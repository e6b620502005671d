"""`make bench-compare OLD=a.json NEW=b.json`: rows that have become slower, relative to a reference job."""

from __future__ import annotations

import json
import sys
from pathlib import Path

LIMIT = 1.15
"""A time over that of the reference job that has grown by more than this factor fails."""


def costs(path: Path) -> dict[str, float]:
    """Times over the reference's, by what was timed."""
    rows = json.loads(path.read_text(encoding="utf-8"))["rows"]
    return {f"{row['table']}: {row['what']}": row["cost"] for row in rows if row["cost"] is not None}


def slower(old: dict[str, float], new: dict[str, float]) -> list[str]:
    """What costs more than it did; rows of one run alone are left out."""
    return [name for name in old if name in new and new[name] > LIMIT * old[name]]


def main() -> int:
    """The exit code: 1 where something has become slower."""
    old, new = (costs(Path(name)) for name in sys.argv[1:3])
    print("| what | old | new | new / old |\n|---|---|---|---|")
    for name in old:
        if name in new:
            print(f"| {name} | {old[name]:.3f} | {new[name]:.3f} | {new[name] / old[name]:.2f} |")
    worse = slower(old, new)
    for name in worse:
        print(f"more than {LIMIT:.2f} times as much: {name}", file=sys.stderr)
    return bool(worse)


if __name__ == "__main__":
    sys.exit(main())
