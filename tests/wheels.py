"""`make wheels`: each of the three wheels, alone in an empty environment, does what it promises and leaves no trace.

Every environment lies outside the checkout and holds only what the wheel asks for, from the package index, with the
versions of constraints.txt. Takes some minutes and a gigabyte each; downloads are kept by pip.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

COMMON = """
ndtorch --help
ndtorch render two-bars bars.mp4 --seconds 0.5
ndtorch bind bars.mp4 --pictures 0
"""
WORKS = {
    "ndtorch": """
        ndtorch scenes
        ndtorch bind two-bars --seconds 1 --pictures 0
        ndtorch bind bars.mp4 --model scale-free --pictures 0
        ndtorch bind bars.mp4 --model retinotopic --pictures 0
        python -m ndtorch scenes
    """,
    "ndtorch-robot[sim]": """
        ndtorch arenas
        ndtorch drive --seconds 2 --record rec.mcap
        ndtorch replay rec.mcap
        ndtorch evaluate --arenas room --seconds 1 --seeds 1000 --jobs 1
    """,
    "ndtorch-train": """
        ndtorch reproduce A3 A9 --quick
        ndtorch first-stage --radius 0.2
        ndtorch sweep small.toml
    """,
}
"""Commands that must end well, by what is installed."""

LACKS = {
    "ndtorch": {
        "ndtorch drive": "pip install ndtorch-robot",
        "ndtorch benchmark": "pip install ndtorch-train",
    }
}
"""Commands that must end with code 2 and one line, and what that line names."""


def main() -> int:
    """Build, then try each wheel; returns 0 if all went well."""
    with tempfile.TemporaryDirectory(prefix="wheels-") as scratch:
        wheels = Path(scratch, "wheels")
        projects = [str(ROOT), str(ROOT / "robot"), str(ROOT / "train")]
        call([sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--wheel-dir", str(wheels), *projects], ROOT)
        for number, name in enumerate(WORKS):
            try_wheel(name, wheels, Path(scratch, str(number)))
    print("all wheels work alone")
    return 0


def try_wheel(name: str, wheels: Path, folder: Path) -> None:
    """Install a wheel into an empty environment, run it, and take it away again."""
    folder.mkdir()
    (folder / "small.toml").write_text("[vary]\nphase = [60, 290]\n[fixed]\nseconds = 2\n")
    call([sys.executable, "-m", "venv", "venv"], folder)
    binaries = folder / "venv" / "bin"
    pip = [str(binaries / "python"), "-m", "pip", "--quiet", "--disable-pip-version-check"]
    call([*pip, "install", "--find-links", str(wheels), "-c", str(ROOT / "constraints.txt"), name], folder)
    call([*pip, "check"], folder)
    for line in filter(str.strip, (COMMON + WORKS[name]).splitlines()):
        command, *rest = line.split()
        call([str(binaries / command), *rest], folder)
    for line, words in LACKS.get(name, {}).items():
        command, *rest = line.split()
        said = call([str(binaries / command), *rest], folder, 2)
        assert words in said, said
        assert said.count("error:") == 1, said
    call([*pip, "uninstall", "--yes", "ndtorch", "ndtorch-robot", "ndtorch-train"], folder)
    left = [path for path in (folder / "venv").rglob("*ndtorch*") if path.is_file()]
    assert not left, left
    size = sum(path.stat().st_size for path in (folder / "venv").rglob("*") if path.is_file()) / 1e6
    print(f"{name:20} works ({size:.0f} MB with all that it needs) and goes without a trace", flush=True)


def call(command: Sequence[str], folder: Path, code: int = 0) -> str:
    """Run a command that must end with that code, without anything that leads to the checkout; returns what it says."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
    done = subprocess.run(command, cwd=folder, env=kept, capture_output=True, text=True, check=False)
    if done.returncode != code:
        raise SystemExit(f"{' '.join(command)}: exit code {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout + done.stderr


if __name__ == "__main__":
    sys.exit(main())
