"""Packages that only some commands need, and what to install where one is missing."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from importlib.metadata import PackageNotFoundError, requires
from re import fullmatch
from typing import Any

from ndtorch.errors import InputError

OURS = ("ndtorch", "ndtorch-robot", "ndtorch-train")
"""Distributions whose dependencies are looked through, in this order."""

NAMES = {
    "av": "av",
    "cv2": "opencv-python-headless",
    "mujoco": "mujoco",
    "picard": "python-picard",
    "pyarrow": "pyarrow",
    "ray": "ray",
    "rerun": "rerun-sdk",
    "serial": "pyserial",
    "sklearn": "scikit-learn",
    "tomli_w": "tomli-w",
}
"""Names of distributions by the names that are imported; others are called as they are imported."""


def need(module: str, what: str) -> Any:
    """Import a module that is not always installed.

    Args:
        module: its name, such as `"mujoco"`.
        what: what needs it, for the message: `"the simulator"`.

    Returns:
        The module.

    Raises:
        InputError: it is not installed, with the words that install it.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        top = module.split(".")[0]
        # Only its own absence: what an installed package misses itself is told as it is.
        if error.name is None or error.name.split(".")[0] != top:
            raise
        words = remedy(top)
        raise InputError(f"{what} needs {top}, which is not installed" + (f": {words}" if words else "")) from None


def remedy(module: str) -> str | None:
    """The command that installs a module, and which of our extras has it. None for modules that we do not ask for.

    The command names the package itself: that can be had from an index, wherever our own distributions came from.

    Args:
        module: top-level name, as it is imported.
    """
    wanted = NAMES.get(module, module)
    extras = sorted(
        (extra != "", OURS.index(ours), f"{ours}[{extra}]" if extra else ours, asked)
        for ours in OURS
        for name, extra, asked in dependencies(ours)
        if name == wanted and extra != "dev"
    )
    return f"pip install '{extras[0][3]}' (of {extras[0][2]})" if extras else None


def dependencies(distribution: str) -> Iterator[tuple[str, str, str]]:
    """What an installed distribution asks for: name, extra ("" for none), name with versions. Nothing if it is not."""
    try:
        lines = requires(distribution) or []
    except PackageNotFoundError:
        return
    for line in lines:
        found = fullmatch(r"([\w.-]+).*?(?:extra\s*==\s*['\"]([\w-]+)['\"].*)?", line)
        if found is not None:
            yield found[1].lower().replace("_", "-"), found[2] or "", line.split(";")[0].strip()
