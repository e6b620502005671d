"""What is installed: optional packages and how to install them, files beside a package, a digest of its code."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ndtorch.errors import InputError, did_you_mean

OURS = ("ndtorch", "ndtorch-robot", "ndtorch-train")
"""Distributions of this project."""

NAMES = {
    "av": "av",
    "cv2": "opencv-python-headless",
    "gymnasium": "gymnasium",
    "mcap": "mcap",
    "numba": "numba",
    "pyarrow": "pyarrow",
    "ray": "ray",
    "rerun": "rerun-sdk",
    "serial": "pyserial",
    "sklearn": "scikit-learn",
}
"""What to install for a module that some commands need."""


def need(module: str, what: str) -> Any:
    """Import a module that not everybody has; `InputError` says `what` needs it and how to install it."""
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
    """The command that installs a module; None for modules that nothing here needs."""
    return f"pip install {NAMES[module]}" if module in NAMES else None


def folder_of(package: str, name: str) -> Path:
    """A folder of files that comes with a package: inside it, or in a checkout beside it."""
    spec = find_spec(package)
    for root in (spec.submodule_search_locations or ()) if spec is not None else ():
        for folder in (Path(root, name), Path(root).parent / name):
            if folder.is_dir():
                return folder
    raise LookupError(f"no folder {name!r} comes with {package}")


def toml_file(given: Path, package: str, name: str) -> Path:
    """A TOML file that a user names: a path, or the bare name of one that comes with a package."""
    if given.suffix or len(given.parts) != 1 or given.exists():
        return given
    known = {path.stem: path for path in sorted(folder_of(package, name).glob("*.toml"))}
    if given.name not in known:
        raise InputError(
            f"{given} is no file, and none of {', '.join(known)}, which come with {package}"
            f"{did_you_mean(given.name, known)}"
        )
    return known[given.name]


@cache
def code_digest(packages: tuple[str, ...], others: tuple[str, ...]) -> str:
    """Hash of the source of packages, wherever they are installed, and of the versions of other distributions."""
    digest = hashlib.sha256(repr([(name, version(name)) for name in others]).encode())
    for package in packages:
        spec = find_spec(package)
        for root in (spec.submodule_search_locations or ()) if spec is not None else ():
            for file in sorted(Path(root).rglob("*.py")):
                digest.update(file.relative_to(root).as_posix().encode() + file.read_bytes())
    return digest.hexdigest()
