"""`make lock`: writes the lock files of this folder, one for each distribution and one for each of its extras.

Each holds what that extra needs, everything below it included, at the versions of constraints.txt where those name one,
for every system and every Python from 3.11 on, with the hashes of all files. torch and torchvision are left out: which
of their builds is right depends on the machine, and so does the hash. It needs `uv`, and asks the index that it knows.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = {"ndtorch": ".", "ndtorch-robot": "robot", "ndtorch-train": "train"}
LEFT_OUT = ("torch", "torchvision")
OURS = "ndtorch"
HEADER = "# Written by `make lock`. torch and torchvision come from their own index: see docs/trust.md.\n"


def name_of(requirement: str) -> str:
    """`rerun-sdk` of `rerun-sdk>=0.41,<0.42`."""
    end = next((n for n, c in enumerate(requirement) if not (c.isalnum() or c in "-_.")), len(requirement))
    return requirement[:end].lower()


def project(name: str) -> dict[str, list[str]]:
    """What a distribution needs, under "", and what each extra adds."""
    table = tomllib.loads((ROOT / FOLDERS[name] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return {"": table["dependencies"], **table.get("optional-dependencies", {})}


def needs(name: str, extra: str = "") -> list[str]:
    """The requirements of a distribution, with one of its extras, on others than ours; ours are followed."""
    found: set[str] = set()
    for requirement in [*project(name)[""], *(project(name)[extra] if extra else [])]:
        other = name_of(requirement)
        if other in FOLDERS:
            extras = requirement[requirement.find("[") + 1 : requirement.find("]")] if "[" in requirement else ""
            found.update(needs(other, extras))
        elif other not in LEFT_OUT:
            found.add(requirement)
    return sorted(found)


def locks() -> dict[str, list[str]]:
    """The requirements of every lock file by its name."""
    return {f"{name}-{extra}" if extra else name: needs(name, extra) for name in FOLDERS for extra in project(name)}


def write(name: str, requirements: list[str]) -> None:
    """One file."""
    with tempfile.TemporaryDirectory() as folder:
        wanted, never, made = (Path(folder) / file for file in ("wanted.in", "never.txt", "made.txt"))
        wanted.write_text("\n".join(requirements) + "\n", encoding="utf-8")
        never.write_text("".join(f"{package} ; python_version < '3'\n" for package in LEFT_OUT), encoding="utf-8")
        options = ["--universal", "--python-version", "3.11", "--generate-hashes", "--no-header", "--no-annotate"]
        command = ["uv", "pip", "compile", "-q", str(wanted), "-c", str(ROOT / "constraints.txt")]
        subprocess.run([*command, "--override", str(never), *options, "-o", str(made)], check=True)
        text = HEADER + made.read_text(encoding="utf-8")
    (ROOT / "requirements" / f"{name}.txt").write_text(text, encoding="utf-8")


def main() -> int:
    """All of them."""
    for name, requirements in locks().items():
        write(name, requirements)
        print(name)
    return 0


if __name__ == "__main__":
    sys.exit(main())
