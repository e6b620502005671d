"""The report of a run: one HTML file that opens anywhere, with its pictures and films inside.

Every command fills in a `Page`; pages of another shape extend `base.html` from a folder of their own.
"""

from __future__ import annotations

import base64
import platform
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

from ndtorch.files import write_text

KINDS = {".png": "image/png", ".svg": "image/svg+xml", ".mp4": "video/mp4"}
"""What is embedded, by suffix."""

LARGEST = 24_000_000
"""Bytes of a film that is embedded; a larger one stays beside the page, and the page links it."""

NAME = "report.html"


class Table(NamedTuple):
    """A table of a page: its title, its heads, its rows as text, and a remark below it."""

    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""


class Shown(NamedTuple):
    """A picture or film of a page: the file, its title, and what there is to see in it."""

    file: Path
    title: str
    caption: str


@dataclass
class Page:
    """What a report says.

    Attributes:
        title: what was looked at.
        answer: what was found, a paragraph each.
        command: how to run it again.
        facts: model, versions and the rest, by name.
        tables, shown: in the order of the page. Files that are not there are left out.
    """

    title: str
    answer: Sequence[str]
    command: str
    facts: Mapping[str, str]
    tables: Sequence[Table] = ()
    shown: Sequence[Shown] = field(default_factory=list)

    def write(self, folder: Path) -> Path:
        """Write report.html into `folder`; returns the file."""
        media = [
            {
                "title": one.title,
                "caption": one.caption,
                "film": one.file.suffix == ".mp4",
                "address": address(one.file),
            }
            for one in self.shown
            if one.file.is_file()
        ]
        text = render(
            "run.html",
            title=self.title,
            answer=self.answer,
            command=self.command,
            facts=self.facts,
            tables=self.tables,
            media=media,
        )
        path = folder / NAME
        write_text(path, text)
        return path


def render(template: str, folder: Path | None = None, **values: Any) -> str:
    """A template filled in.

    Args:
        template: name of the file.
        folder: more templates, which may extend `base.html`.
        values: what it asks for; text is escaped.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    places = [Path(__file__).with_name("templates"), *([] if folder is None else [folder])]
    house = Environment(
        loader=FileSystemLoader(places),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return house.get_template(template).render(**values)


def address(file: Path) -> str:
    """A picture or film as a data address; of a film too large for that, its name beside the page."""
    if file.suffix == ".mp4" and file.stat().st_size > LARGEST:
        return file.name
    return f"data:{KINDS[file.suffix]};base64,{base64.b64encode(file.read_bytes()).decode()}"


def versions(*distributions: str) -> dict[str, str]:
    """Python, the processor and the versions of what was used, as facts of a page."""
    found = {}
    for name in ("ndtorch", *distributions, "torch"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return {**found, "Python": platform.python_version(), "machine": f"{platform.system()}, {platform.machine()}"}


def command_line() -> str:
    """The command that this process was started with, to run it again."""
    name = Path(sys.argv[0]).name
    return shlex.join(["ndtorch" if name in ("__main__.py", "ndtorch") else name, *sys.argv[1:]])


def open_in_browser(page: Path) -> None:
    """Show a page in the browser of this machine; where there is none, nothing happens."""
    import webbrowser

    webbrowser.open(page.resolve().as_uri())
