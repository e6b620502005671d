"""How the documentation is built: `make docs`."""

from __future__ import annotations

import html
import importlib
import importlib.metadata
import os
import re
from pathlib import Path
from typing import Any

from pygments.lexers.special import TextLexer

project = "ndtorch"
author = "the ndtorch maintainers"
copyright = "2026 The ndtorch authors"
release = importlib.metadata.version("ndtorch")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["examples"]
suppress_warnings = ["config.cache"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
autodoc_typehints = "description"
autodoc_member_order = "bysource"
napoleon_google_docstring = True
napoleon_use_ivar = True
html_theme = "furo"
html_title = "ndtorch"
sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"/[a-z].*\.py",
    "remove_config_comments": True,
    "abort_on_example_error": True,
    "min_reported_time": 1,
}


ROOT = Path(__file__).resolve().parents[1]
COPIES = ROOT / "docs" / "checkout"
"""Where pages of the site come from that lie elsewhere in the checkout: copies, made anew by every build."""

ELSEWHERE = [
    ROOT / "README.md",
    ROOT / "CHANGELOG.md",
    *(page for part in ("robot", "train", "models") for page in (ROOT / part).rglob("*.md")),
]


EXAMPLES = ROOT / "docs" / "examples"


def on_the_site(file: Path) -> Path:
    """Where the site has a file of the checkout."""
    if file.parent == EXAMPLES:
        return ROOT / "docs" / "gallery" / ("index.rst" if file.suffix == ".rst" else file.with_suffix(".rst").name)
    return COPIES / file.relative_to(ROOT) if file in ELSEWHERE else file


def links_on_the_site(text: str, page: Path) -> str:
    """The text of a page with its links to files as they are from where the site has the page."""

    def moved(match: re.Match[str]) -> str:
        target, anchor = match["target"], match["anchor"] or ""
        file = Path(os.path.normpath(page.parent / target))
        if "://" in target or not file.is_file():
            return match[0]
        return f"]({os.path.relpath(on_the_site(file), on_the_site(page).parent)}{anchor})"

    return re.sub(r"\]\((?P<target>[^)#\s]+)(?P<anchor>#[^)]*)?\)", moved, text)


def copy_pages(app: Any, config: Any) -> None:
    """Copy the pages that lie elsewhere; those that are the same stay, so that they are not built again."""
    for page in ELSEWHERE:
        copy, text = on_the_site(page), links_on_the_site(page.read_text(encoding="utf-8"), page)
        if not copy.exists() or copy.read_text(encoding="utf-8") != text:
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_text(text, encoding="utf-8")
    for copy in set(COPIES.rglob("*.md")) - {on_the_site(page) for page in ELSEWHERE}:
        copy.unlink()


def lead_to_copies(app: Any, name: str, source: list[str]) -> None:
    """Links of the pages in docs/ to pages that lie elsewhere."""
    page = Path(app.env.doc2path(name))
    if page.suffix == ".md" and COPIES not in page.parents:
        source[0] = links_on_the_site(source[0], page)


COMMON = {
    "vision": "VisualFeatures HassensteinReichardt OrientedDoG HighPass LowPass NDMin FEATURES",
    "scenes": "two_bars three_bars one_bar equal_bars make_scene open_video FrameSource BarScene RandomShadow",
    "binding": "BindingModel BindingInputs InhibitoryNetwork learning_rule object_table BoundObject Attention",
    "navigation": "Navigator StereoRig Command StereoRanging GridMap Localiser NavigatorState",
}
"""The names of a package that its page has first: autodoc keeps the order of `__all__`."""


def import_public_names(app: Any, config: Any) -> None:
    """Import every public name, since packages do it at first use and autodoc sees only what is there."""
    for name, common in COMMON.items():
        package = importlib.import_module(f"ndtorch.{name}")
        for public in package.__all__:
            setattr(package, public, getattr(package, public))
        first = [public for public in common.split() if public in package.__all__]
        package.__all__ = [*first, *(public for public in package.__all__ if public not in first)]


def without_inherited_text(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Remove the text that torch's Module gives to every `forward`; the class says what it returns."""
    if any("overridden by all subclasses" in line for line in lines):
        lines.clear()


def examples_as_list(app: Any) -> None:
    """Where examples are not run there are no thumbnails: the gallery's page is a list then."""
    if app.config.plot_gallery not in ("0", "False", False):
        return
    page = ROOT / "docs" / "gallery" / "index.rst"
    text = page.read_text(encoding="utf-8")
    entries = re.findall(r'tooltip="(.*?)">.*?:doc:`(/gallery/\w+)`.*?thumbnail-title">(.*?)</div>', text, re.DOTALL)
    head, rest = text.split(".. raw:: html", 1)
    listed = "\n".join(f"- :doc:`{title} <{file}>`. {html.unescape(what)}" for what, file, title in entries)
    page.write_text(f"{head}{listed}\n\n.. toctree::{rest.split('.. toctree::', 1)[1]}", encoding="utf-8")


def shapes_as_lines(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """The section "Shapes:" of a docstring as a list: its entries are not names of parameters."""
    if "Shapes:" not in lines:
        return
    start = lines.index("Shapes:")
    end = next((n for n in range(start + 1, len(lines)) if lines[n] and not lines[n].startswith(" ")), len(lines))
    entries: list[str] = []
    for line in lines[start + 1 : end]:
        if entries and not re.match(r"    \S[^:`]*: ", line):
            entries[-1] += " " + line.strip()
        elif line.strip():
            entries.append(line.strip())
    lines[start:end] = [".. rubric:: Shapes", "", *(f"- {entry.strip()}" for entry in entries), ""]


def fences_as_blocks(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Code between fences of backticks as a literal block."""
    out, inside = [], False
    for line in lines:
        if line.strip().startswith("```"):
            inside = not inside
            out += ["", ".. code-block:: python", ""] if inside else [""]
        else:
            out.append("    " + line if inside else line)
    lines[:] = out


def setup(app: Any) -> None:
    # Diagrams are shown as they are written.
    app.add_lexer("mermaid", TextLexer)
    app.connect("config-inited", copy_pages)
    app.connect("config-inited", import_public_names)
    app.connect("source-read", lead_to_copies)
    # After the gallery was written.
    app.connect("builder-inited", examples_as_list, priority=900)
    # Before napoleon reads the docstring.
    app.connect("autodoc-process-docstring", without_inherited_text, priority=80)
    app.connect("autodoc-process-docstring", fences_as_blocks, priority=90)
    app.connect("autodoc-process-docstring", shapes_as_lines, priority=100)
