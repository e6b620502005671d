"""Files that come with a package and are no code: inside it where it is installed, beside it in a checkout."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from ndtorch.errors import InputError
from ndtorch.nearest import meant


def folder_of(package: str, name: str) -> Path:
    """A folder of files that comes with a package.

    Args:
        package: such as `"ndtorch_robot"`.
        name: of the folder, such as `"configs"`.

    Raises:
        LookupError: the package, or the folder, is not there.
    """
    spec = find_spec(package)
    for root in (spec.submodule_search_locations or ()) if spec is not None else ():
        for place in (Path(root, name), Path(root).parent / name):
            if place.is_dir():
                return place
    raise LookupError(f"no folder {name!r} comes with {package}")


def toml_file(given: Path, package: str, name: str) -> Path:
    """A TOML file that a user names: a path, or the bare name of one that comes with a package.

    Args:
        given: what the user wrote.
        package, name: as for `folder_of`.

    Raises:
        InputError: a bare name that none of them has.
    """
    if given.suffix or len(given.parts) != 1 or given.exists():
        return given
    known = {path.stem: path for path in sorted(folder_of(package, name).glob("*.toml"))}
    if given.name not in known:
        raise InputError(
            f"{given} is no file, and none of {', '.join(known)}, which come with {package}{meant(given.name, known)}"
        )
    return known[given.name]
