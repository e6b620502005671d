"""Ctrl-C at any time ends a command with one line."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

SWALLOWS = """
import os, signal
try:
    os.kill(os.getpid(), signal.{name})
    while True:  # a signal is handled between two steps
        pass
except BaseException:
    raise ImportError("something went wrong in C++") from None
"""
"""A module that is interrupted while it is being imported, and says that it was something else."""

LATE = """
import atexit, os, signal, sys
atexit.register(lambda: [os.kill(os.getpid(), signal.SIGINT), [None for _ in range(1000)]])
sys.argv = ["ndtorch", "--version"]
from ndtorch.__main__ import program
sys.exit(program())
"""


def ended(program: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A program that finds modules in this folder first."""
    path = os.pathsep.join([str(folder), str(ROOT), str(ROOT / "robot"), str(ROOT / "train")])
    return subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_while_torch_is_being_imported(name: str, code: int, tmp_path: Path) -> None:
    """Whatever torch makes of an exception that is raised in the middle of it."""
    (tmp_path / "torch").mkdir()
    (tmp_path / "torch" / "__init__.py").write_text(SWALLOWS.format(name=name))
    words = ["ndtorch", "bind", "two-bars", "--out", str(tmp_path / "out")]
    done = ended(f"import sys; sys.argv = {words}; from ndtorch.__main__ import program; sys.exit(program())", tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (code, "", "stopped before there was anything to keep\n")
    assert not (tmp_path / "out").exists()


def test_while_the_command_is_being_imported(tmp_path: Path) -> None:
    program = "import sys; sys.argv = ['ndtorch', 'drive']; from ndtorch.__main__ import program; sys.exit(program())"
    (tmp_path / "tyro.py").write_text("import os, signal; os.kill(os.getpid(), signal.SIGINT)\nwhile True: pass\n")
    done = ended(program, tmp_path)
    assert (done.returncode, done.stderr.count("\n"), done.stderr[:7]) == (130, 1, "stopped")


def test_while_python_ends(tmp_path: Path) -> None:
    """What was to be told has been told; shells call this 130 too."""
    done = ended(LATE, tmp_path)
    assert (done.returncode, done.stderr) == (-signal.SIGINT, "")
    assert done.stdout.startswith("ndtorch ")
