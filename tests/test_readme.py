"""The README's Python runs as it stands there, and its commands exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import torch

README = (Path(__file__).resolve().parents[1] / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)


@pytest.mark.slow
def test_finding_objects_from_python(capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, object] = {}
    exec(BLOCKS[0], names)
    out = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in out] == ["red", "green", "stable"]


def test_navigating() -> None:
    names: dict[str, object] = {}
    exec(BLOCKS[1], names)
    command = names["command"]
    assert torch.isfinite(command.speed).all()  # type: ignore[attr-defined]
    assert torch.isfinite(command.curvature).all()  # type: ignore[attr-defined]
    assert len(BLOCKS) == 2  # each is run as it is printed


def test_it_can_be_read_in_five_minutes() -> None:
    assert len(README.split()) <= 900


def test_make_targets_exist() -> None:
    makefile = (Path(__file__).resolve().parents[1] / "Makefile").read_text(encoding="utf-8")
    targets = {
        word for pair in re.findall(r"^make (\w+)|`make (\w+)`", README, flags=re.MULTILINE) for word in pair if word
    }
    assert {"demo", "test", "bench", "setup"} <= targets
    for target in targets:
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE)


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
@pytest.mark.parametrize("page", ["start", "binding", "models", "navigation"])
def test_snippets_of_the_pages(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (Path(__file__).resolve().parents[1] / "docs" / f"{page}.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    assert blocks
    monkeypatch.chdir(tmp_path)
    for block in blocks:
        exec(block, {})
