"""What is installed: optional packages and how to install them, files beside a package, a digest of its code."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from pathlib import Path
from re import fullmatch
from typing import Any

from ndtorch.errors import InputError, did_you_mean

OURS = ("ndtorch", "ndtorch-robot", "ndtorch-train")
"""Distributions whose dependencies are looked through, in this order."""

NAMES = {
    "av": "av",
    "cv2": "opencv-python-headless",
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
    """The command that installs a module, and which of our extras has it; None for modules that we do not ask for. It
    names the package itself, which an index has wherever our own distributions came from.
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


def folder_of(package: str, name: str) -> Path:
    """A folder of files that comes with a package."""
    spec = find_spec(package)
    for root in (spec.submodule_search_locations or ()) if spec is not None else ():
        for place in (Path(root, name), Path(root).parent / name):
            if place.is_dir():
                return place
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


SUFFIXES = {".py", ".toml", ".safetensors", ".csv"}
"""Files that results depend on; others are words."""

MODELS = "models"
"""Stands for all models that come with the library."""


@cache
def code_digest(uses: tuple[str, ...], packages: tuple[str, ...] = ("torch",)) -> str:
    """Hash of the source of modules, wherever they are installed, and of the versions of other packages."""
    found = hashlib.sha256()
    for package in packages:
        found.update(f"{package} {version(package)}\n".encode())
    for use in sorted(uses):
        for name, path in files_of(use):
            found.update(name.encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()


def files_of(use: str) -> list[tuple[str, Path]]:
    """Every file of a module or package, with a name that is the same on every machine, in order of the names."""
    places = [folder_of("ndtorch", "models")] if use == MODELS else module_places(use)
    found = sorted(
        (f"{use}/{path.relative_to(place).as_posix()}", path)
        for place in places
        for path in ([place] if place.is_file() else place.rglob("*"))
        if path.suffix in SUFFIXES
    )
    if not found:
        raise LookupError(f"no module {use!r}")
    return found


def module_places(name: str) -> Iterator[Path]:
    """The file of a module, or the folder of a package. Nothing is imported."""
    top, *rest = name.split(".")
    spec = find_spec(top)
    for root in (spec.submodule_search_locations or ()) if spec is not None else ():
        path = Path(root, *rest)
        if path.is_dir():
            yield path
        elif path.with_suffix(".py").is_file():
            yield path.with_suffix(".py")
