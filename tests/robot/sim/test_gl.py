"""An OpenGL context beside other libraries that bring an LLVM."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mujoco")

CHILD = """
import sys
from ndtorch_robot.sim import gl
gl.BEFORE = ("not_installed", "broken", "first")
gl.ctypes.util.find_library = lambda name: name
gl.open_context = lambda *arguments: sys.exit(0 if "first" in sys.modules else 3)
gl.make_context(8, 8)
"""


def test_what_must_come_first_is_loaded_before_the_driver(tmp_path: Path) -> None:
    (tmp_path / "first.py").write_text("")
    (tmp_path / "broken.py").write_text("raise OSError('libcuda is missing')")
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.append({str(tmp_path)!r})\n{CHILD}"], check=False
    )
    assert done.returncode == 0


def test_nothing_is_loaded_where_nothing_is_installed() -> None:
    from ndtorch_robot.sim.gl import load_before

    load_before(("not_installed_at_all",))
    assert "not_installed_at_all" not in sys.modules
