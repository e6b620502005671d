"""`make audit`: asks pip-audit for known holes in every locked package, and says so where it was not told.

pip-audit itself ends with exit code 0 where the index does not know a package, which is what a mirror without the
database of holes answers for all of them.

Exit code 1 where there is a hole, 2 where not everything could be asked.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]


def asked(command: Sequence[str], file: Path, *how: str) -> list[dict[str, Any]]:
    """What pip-audit says of the packages of one file; nothing where it says nothing that can be read."""
    made = subprocess.run([*command, "-r", str(file), "-f", "json", *how], capture_output=True, text=True)
    try:
        found = json.loads(made.stdout)["dependencies"]
    except (ValueError, KeyError, TypeError):
        last = (made.stderr.strip().splitlines() or ["it said nothing"])[-1]
        return [{"name": file.name, "skip_reason": last}]
    return list(found)


def verdict(found: list[dict[str, Any]]) -> tuple[int, list[str]]:
    """The exit code, and what to print."""
    holes = {f"{one['name']} {one['version']}: {hole['id']}" for one in found for hole in one.get("vulns", [])}
    unknown = {one["name"]: one["skip_reason"] for one in found if "skip_reason" in one}
    names = {one["name"] for one in found}
    lines = sorted(holes)
    if unknown:
        why = next(iter(unknown.values()))
        lines.append(f"error: {len(unknown)} of {len(names)} packages were not looked up, the first because: {why}")
    elif not holes:
        lines.append(f"no known holes in {len(names)} packages")
    return (1 if holes else 2 if unknown else 0), lines


def main(command: Sequence[str]) -> int:
    """Ask for the constraints and for all lock files; not for the rest where nothing was told of one of them."""
    found: list[dict[str, Any]] = []
    for file in [ROOT / "constraints.txt", *sorted((ROOT / "requirements").glob("*.txt"))]:
        how = ("--no-deps",) if file.name == "constraints.txt" else ("--require-hashes",)
        here = asked(command, file, "--disable-pip", *how)
        found += here
        if all("skip_reason" in one for one in here):
            break  # who knows none of them knows none of the others
    code, lines = verdict(found)
    print("\n".join(lines))
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:] or ["pip-audit"]))
