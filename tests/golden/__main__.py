"""`python -m tests.golden [WORD ...]` makes the runs whose names hold a word, or all, anew: for meant changes."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from tests.golden.runs import RUNS

FILE = Path(__file__).parent / "runs.json"


def main(words: list[str]) -> None:
    """Make the runs whose name holds one of the words, or all, and keep the others as they are."""
    kept = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
    for name, run in RUNS.items():
        if not words or any(word in name for word in words):
            print(name, flush=True)
            kept[name] = run(None)
    lines = [f"{json.dumps(name)}: {json.dumps(kept[name], separators=(',', ':'))}" for name in RUNS if name in kept]
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
