"""The README's Python and examples in docstrings run as they stand, and what pages name exists."""

from __future__ import annotations

import doctest
import inspect
import re
from pathlib import Path

import pytest
import torch

import ndtorch
import ndtorch.binding
import ndtorch.navigation
import ndtorch.scenes
import ndtorch.vision

README = (Path(__file__).resolve().parents[1] / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)


@pytest.mark.slow
def test_finding_objects_from_python(capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, object] = {}
    exec(BLOCKS[0], names)
    out = capsys.readouterr().out.splitlines()
    *objects, verdict = (line.split()[0] for line in out)
    assert (sorted(objects), verdict) == (["green", "red"], "stable")


def test_navigating() -> None:
    names: dict[str, object] = {}
    exec(BLOCKS[1], names)
    command = names["command"]
    assert torch.isfinite(command.speed).all()  # type: ignore[attr-defined]
    assert torch.isfinite(command.curvature).all()  # type: ignore[attr-defined]
    assert len(BLOCKS) == 2  # each is run as it is printed


def test_links_lead_somewhere() -> None:
    """Of the README and of every page: files that are linked exist."""
    root = Path(__file__).resolve().parents[1]
    pages = [path for path in root.rglob("*.md") if ".venv" not in path.parts and "out" not in path.parts]
    assert len(pages) > 10
    missing = []
    for page in pages:
        for link in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            if "://" not in link and not (page.parent / link).exists():
                missing.append(f"{page.relative_to(root)}: {link}")
    assert missing == []


def test_what_the_pages_call_exists() -> None:
    """Modules and test files that a page runs, and targets of `make`."""
    root = Path(__file__).resolve().parents[1]
    targets = re.findall(r"^([a-z-]+):", (root / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE)
    missing = []
    for page in [*(root / "docs").rglob("*.md"), *root.glob("*.md"), *(root / "robot").glob("*.md")]:
        text = page.read_text(encoding="utf-8")
        modules = [root / name.replace(".", "/") for name in re.findall(r"python -m (tests[.\w]+)", text)]
        files = [root / name for name in re.findall(r"[` ](tests/[\w/.]+)", text)]
        missing += [str(path) for path in modules if not (path.is_dir() or path.with_suffix(".py").is_file())]
        missing += [str(path) for path in files if not path.exists()]
        missing += [f"make {name}" for name in re.findall(r"`make ([a-z][a-z-]*)", text) if name not in targets]
    assert missing == []


@pytest.mark.slow
@pytest.mark.parametrize("page", ["binding", "models", "navigation"])
def test_snippets_of_the_pages(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (Path(__file__).resolve().parents[1] / "docs" / f"{page}.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    assert blocks
    monkeypatch.chdir(tmp_path)
    for block in blocks:
        exec(re.sub(r"seconds=\d+", "seconds=1", block), {})


ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "design.md").read_text(encoding="utf-8")
NAMED = sorted(set(re.findall(r"`((?:ndtorch|robot|train|models|tests|docs)/[\w./-]+)`", PAGE)))


@pytest.mark.parametrize("path", NAMED)
def test_a_path_of_the_page_exists(path: str) -> None:
    assert (ROOT / path).exists()


PACKAGES = [ndtorch, ndtorch.vision, ndtorch.scenes, ndtorch.binding, ndtorch.navigation]
PUBLIC = {id(thing): thing for package in PACKAGES for thing in (getattr(package, name) for name in package.__all__)}
EXAMPLES = {
    test.name: test
    for thing in PUBLIC.values()
    if inspect.isclass(thing) or inspect.isfunction(thing)
    for test in doctest.DocTestFinder(exclude_empty=True).find(
        thing, f"{thing.__module__}.{thing.__qualname__}", globs={"torch": torch, thing.__name__: thing}
    )
    if test.examples
}


@pytest.mark.parametrize("name", sorted(EXAMPLES))
def test_an_example_prints_what_it_says(name: str) -> None:
    told: list[str] = []
    result = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(EXAMPLES[name], out=told.append)
    assert result.attempted > 0
    assert result.failed == 0, "".join(told)
