"""Which tests are asked about a change of a module: its mirrored file, and then those that use most of it."""

from __future__ import annotations

import ast
import functools
import re
from pathlib import Path

from tests.test_mirror import MIRRORS, TESTED_IN

USES = 5
"""Naming the module counts as much as so many mentions of what is in it."""


def mirrored(file: str) -> str:
    """The file of tests of a module."""
    package = next(package for package in MIRRORS if file.startswith(package + "/"))
    inside = Path(file).relative_to(package).with_suffix("")
    name = (Path(MIRRORS[package]) / inside).as_posix()
    mirror = TESTED_IN.get(name)
    return (Path("tests") / (f"{mirror}.py" if mirror else f"{Path(name).parent}/test_{inside.name}.py")).as_posix()


def tests_of(file: str, root: Path, also: dict[str, list[str]], most: int) -> list[str]:
    """Files of tests, the likeliest first: each is asked only where those before it have noticed nothing.

    First the mirrored file, then those that use the module, those of the modules that import it, and what `also` says
    of the longest prefix that fits; of all but the first no more than `most`.
    """
    first = mirrored(file)
    longest = max((prefix for prefix in also if file.startswith(prefix)), key=len, default="")
    wider = [*users(file, root), *(mirrored(each) for each in importers(file, root)), *also.get(longest, [])]
    found = [test for test in dict.fromkeys(wider) if test != first and (root / test).is_file()]
    return [test for test in (first, *found[:most]) if (root / test).is_file()]


def dotted(file: str) -> str:
    """Name of the module in a file."""
    return Path(file).with_suffix("").as_posix().removeprefix("robot/").removeprefix("train/").replace("/", ".")


def users(file: str, root: Path) -> list[str]:
    """Files of tests that name the module or import what it defines, the ones with most mentions first."""
    tree = ast.parse((root / file).read_text(encoding="utf-8"))
    defined = {node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)}
    module = dotted(file)
    package = re.escape(module.rpartition(".")[0])
    found = {}
    for test, text in sources(root, "tests", "test_*.py").items():
        imported = re.findall(rf"^from {package}(?:\.\w+)* import (\([^)]*\)|.*)$", text, re.MULTILINE)
        mine = defined & {word for names in imported for word in re.findall(r"\w+", names)}
        mentions = sum(len(re.findall(rf"\b{name}\b", text)) for name in mine)
        mentions += USES * len(re.findall(rf"\b{re.escape(module)}\b", text))
        if mentions:
            found[test] = mentions
    return sorted(found, key=lambda test: (-found[test], test))


def importers(file: str, root: Path) -> list[str]:
    """Modules that import this one by its own name."""
    pattern = re.compile(rf"^\s*(?:from|import) {re.escape(dotted(file))}\b", re.MULTILINE)
    texts = {each: text for package in MIRRORS for each, text in sources(root, package, "*.py").items()}
    return [each for each, text in texts.items() if not each.endswith("__init__.py") and pattern.search(text)]


@functools.cache
def sources(root: Path, folder: str, pattern: str) -> dict[str, str]:
    """Their texts by their paths."""
    files = sorted((root / folder).rglob(pattern))
    return {file.relative_to(root).as_posix(): file.read_text(encoding="utf-8") for file in files}
