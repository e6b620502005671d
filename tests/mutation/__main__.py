"""`make mutants`: small changes of the source, drawn by chance, and which of them no test notices."""

from __future__ import annotations

import argparse
import random
import sys
import time
import tomllib
from collections.abc import Sequence
from pathlib import Path

from tests.mutation import c_changes, python_changes
from tests.mutation.change import Change
from tests.mutation.table import UNASKED, Table, WrongTable, interval, sample_name
from tests.mutation.trial import Bench

ROOT = Path(__file__).parents[2]


def files_of(areas: Sequence[str]) -> list[str]:
    """All sources in those folders, sorted."""
    found: set[Path] = set()
    for area in areas:
        path = ROOT / area
        if not path.exists():
            sys.exit(f"{area}: there is no such file or folder")
        found |= set(path.rglob("*.py")) if path.is_dir() else {path}
    return sorted(file.relative_to(ROOT).as_posix() for file in found if file.name != "__init__.py")


def drawn(
    texts: dict[str, str], number: int | None, seed: int, without: list[str], kept: Path
) -> tuple[list[Change], int]:
    """Changes at `number` different places, one a place, drawn by this seed; and the number of places.

    The first of them are the same whatever `number` is.
    """
    chance = random.Random(seed)
    everywhere = []
    for file, text in texts.items():
        if file.endswith(".c"):
            everywhere += [(file, changes) for changes in c_changes.places(file, text)]
        else:
            everywhere += [(file, changes) for changes in python_changes.kept_places(text, without, kept)]
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
    parser.add_argument("--again", action="store_true", help="ask about those that survived once more")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no further change after this long")
    parser.add_argument("--out", type=Path, default=Path("out/mutants/mutants.tsv"), help="one line for every change")
    given = parser.parse_args()
    settings = tomllib.loads((Path(__file__).parent / "mutation.toml").read_text(encoding="utf-8"))
    work = given.out.parent
    work.mkdir(parents=True, exist_ok=True)
    texts = {file: (ROOT / file).read_text(encoding="utf-8") for file in files_of(given.only or settings["areas"])}
    changes, number = drawn(texts, given.sample or None, given.seed, settings["without"], work / "places")
    try:
        table = Table(given.out, sample_name(given.seed, texts, settings["without"]))
    except WrongTable as error:
        sys.exit(str(error))
    done = table.counts()[1]
    print(f"{number} places in {len(texts)} files; {len(changes)} changes, seed {given.seed}, {done} known", flush=True)
    began = time.monotonic()
    with Bench(ROOT, (work / "tree").resolve(), given.python, settings, given.mirrored) as bench:
        for place, change in enumerate(changes):
            known = table.outcome(place)
            asked = known is not None and not (known == UNASKED and not given.mirrored)
            if asked and not (given.again and str(known).startswith("survived")):
                continue
            if time.monotonic() - began > 60 * given.minutes:
                print("the rest was not begun: the time is over")
                break
            outcome = bench.try_change(change, begin=int(known == UNASKED and not given.again))
            shown = change.shown(texts[change.file])
            table.put(place, outcome, f"{change.file}:{change.line}", change.kind, shown)
            if outcome.startswith("survived"):
                print(f"{place} {outcome}  {change.file}:{change.line}  {shown}", flush=True)
    noticed, tried = table.counts()
    low, high = interval(noticed, tried)
    share = f"{100 * noticed / max(tried, 1):.0f} %, 95 % interval {100 * low:.0f} to {100 * high:.0f} %"
    print(f"{noticed} of {tried} noticed ({share}), {given.out}")


if __name__ == "__main__":
    main()
