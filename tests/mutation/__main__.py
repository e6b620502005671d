"""`make mutants`: small changes of the source, drawn by chance, and which of them no test notices."""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import time
import tomllib
from pathlib import Path

from tests.mutation import c_changes, python_changes
from tests.mutation.change import Change
from tests.mutation.trial import Bench

ROOT = Path(__file__).parents[2]


def files_of(areas: list[str]) -> list[str]:
    """All sources in those folders, sorted."""
    found: set[Path] = set()
    for area in areas:
        path = ROOT / area
        if not path.exists():
            sys.exit(f"{area}: there is no such file or folder")
        found |= set(path.rglob("*.py")) if path.is_dir() else {path}
    return sorted(file.relative_to(ROOT).as_posix() for file in found if file.name != "__init__.py")


def drawn(files: list[str], number: int | None, seed: int, without: list[str]) -> tuple[list[Change], int]:
    """Changes at `number` different places, one a place, drawn by this seed; and the number of places."""
    chance = random.Random(seed)
    texts = {file: (ROOT / file).read_text(encoding="utf-8") for file in files}
    everywhere = []
    for file, text in texts.items():
        if file.endswith(".c"):
            everywhere += [(file, changes) for changes in c_changes.places(file, text)]
        else:
            everywhere += [(file, changes) for changes in python_changes.places(text, without)]
    chance.shuffle(everywhere)
    changes: list[Change] = []
    for file, options in everywhere:
        if number is not None and len(changes) >= number:
            break
        option = chance.choice(options)
        change = option if isinstance(option, Change) else python_changes.change(file, texts[file], *option)
        if change is not None:
            changes.append(change)
    return changes, len(everywhere)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument("--sample", type=int, default=40, help="places to change; 0 for all of them")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="*", help="these files or folders; all areas of mutation.toml otherwise")
    parser.add_argument("--python", default=sys.executable, help="runs the tests")
    parser.add_argument("--mirrored", action="store_true", help="ask the mirrored test files alone: quicker, stricter")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no further change after this long")
    parser.add_argument("--out", type=Path, default=Path("out/mutants.tsv"), help="one line for every change")
    given = parser.parse_args()
    settings = tomllib.loads((Path(__file__).parent / "mutation.toml").read_text(encoding="utf-8"))
    files = files_of(given.only or settings["areas"])
    changes, number = drawn(files, given.sample or None, given.seed, settings["without"])
    print(f"{number} places in {len(files)} files; {len(changes)} changes, seed {given.seed}")
    given.out.parent.mkdir(parents=True, exist_ok=True)
    began, tried, noticed = time.monotonic(), 0, 0
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder, given.out.open("w", encoding="utf-8") as table:
        bench = Bench(ROOT, Path(folder), given.python, settings, given.mirrored)
        table.write("outcome\tplace\tkind\tchange\n")
        for change in changes:
            if time.monotonic() - began > 60 * given.minutes:
                print(f"{len(changes) - tried} were not begun: the time is over")
                break
            outcome = bench.try_change(change)
            shown = change.shown((ROOT / change.file).read_text(encoding="utf-8"))
            table.write(f"{outcome}\t{change.file}:{change.line}\t{change.kind}\t{shown}\n")
            table.flush()
            tried += outcome != "does not compile"
            noticed += outcome.startswith("noticed")
            if outcome == "survived":
                print(f"survived  {change.file}:{change.line}  {shown}", flush=True)
    print(f"{noticed} of {tried} noticed ({100 * noticed / max(tried, 1):.0f} %), {given.out}")


if __name__ == "__main__":
    main()
