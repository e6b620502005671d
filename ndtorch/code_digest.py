"""A short name for the code that a result depends on, so that a result of other code is known as such."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from ndtorch.installed import folder_of

SUFFIXES = {".py", ".toml", ".safetensors", ".csv"}
"""Files that results depend on; others are words."""

MODELS = "models"
"""Stands for all models that come with the library."""


@cache
def code_digest(uses: tuple[str, ...], packages: tuple[str, ...] = ("torch",)) -> str:
    """Hash of the source of modules, wherever they are installed, and of the versions of other packages.

    Args:
        uses: modules and whole packages by their dotted names, such as `"ndtorch.vision"`, or `MODELS`.
        packages: distributions of which the version counts.

    Raises:
        LookupError: there is no such module, or no such distribution.
    """
    found = hashlib.sha256()
    for package in packages:
        found.update(f"{package} {version(package)}\n".encode())
    for use in sorted(uses):
        for name, path in files_of(use):
            found.update(name.encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()


def files_of(use: str) -> list[tuple[str, Path]]:
    """Every file of a module or package, with a name that is the same on every machine, in order of the names.

    Raises:
        LookupError: there is no such module.
    """
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
