"""Drawing without a screen: EGL where it works, else OSMesa, else a line that says what to install."""

from __future__ import annotations

import contextlib
import ctypes.util
import importlib
import os
import sys
from typing import Any

from ndtorch.errors import InputError

PACKAGES = {"egl": "libegl1 libgl1-mesa-dri", "osmesa": "libosmesa6"}
"""Debian and Ubuntu packages that bring each library."""

BEFORE = ("triton._C.libtriton",)
"""What must be loaded before a software driver of Mesa, if it is installed. Both bring an LLVM of their own. When the
one of Triton comes second, its constructors crash the process. PyTorch for CUDA brings Triton and loads it as soon as
something is compiled or exported."""


def make_context(width: int, height: int) -> Any:
    """A current OpenGL context for MuJoCo; call its `free()` when done.

    The environment variable MUJOCO_GL, when set to `egl` or `osmesa`, decides; otherwise both are tried.

    Raises:
        InputError: neither library works.
    """
    wanted = os.environ.get("MUJOCO_GL", "").lower()
    names = [wanted] if wanted in PACKAGES else ["egl", "osmesa"]
    reasons = []
    load_before(BEFORE)
    for name in names:
        if not ctypes.util.find_library({"egl": "EGL", "osmesa": "OSMesa"}[name]):
            reasons.append(f"{name}: library not found")
            continue
        try:
            context = open_context(name, width, height)
            context.make_current()
            return context
        except Exception as error:  # every binding fails in its own way
            reasons.append(f"{name}: {type(error).__name__} {str(error).splitlines()[0] if str(error) else ''}".strip())
    packages = " or ".join(f"'{PACKAGES[name]}'" for name in names)
    raise InputError(f"cannot draw without a screen ({'; '.join(reasons)}): install the system package {packages}")


def load_before(modules: tuple[str, ...]) -> None:
    """Import those of the modules that are installed; one that cannot be imported is left out."""
    for module in modules:
        with contextlib.suppress(Exception):
            importlib.import_module(module)


def open_context(name: str, width: int, height: int) -> Any:
    """A context of one library."""
    # Mesa draws with as many threads as there are cores; on strips they wait for each other more than they draw.
    os.environ.setdefault("LP_NUM_THREADS", "0")
    # PyOpenGL chooses its library when first imported: forget an attempt with another one.
    if os.environ.get("PYOPENGL_PLATFORM", name) != name:
        for module in [m for m in sys.modules if m.split(".")[0] == "OpenGL" or m.startswith("mujoco.egl")]:
            del sys.modules[module]
    os.environ["PYOPENGL_PLATFORM"] = os.environ["MUJOCO_GL"] = name
    if name == "egl":
        from mujoco.egl import GLContext
    else:
        from mujoco.osmesa import GLContext
    return GLContext(width, height)
