"""How the documentation is built: `make docs`."""

from __future__ import annotations

import importlib.metadata
import re
from typing import Any

project = "ndtorch"
author = "the ndtorch maintainers"
release = importlib.metadata.version("ndtorch")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["examples"]
# Pages link files of the checkout that are no pages of the site, and docstrings are read as plain text.
suppress_warnings = ["myst.xref_missing", "config.cache"]
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
    # Before napoleon reads the docstring.
    app.connect("autodoc-process-docstring", fences_as_blocks, priority=90)
    app.connect("autodoc-process-docstring", shapes_as_lines, priority=100)
