"""Result pages: one HTML file from a template, with its pictures in it; the page and the folder of a run."""

from __future__ import annotations

import base64
import contextlib
import json
import platform
import re
import shlex
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from ndtorch.binding import save_state
from ndtorch.report.exports import FORMATS
from ndtorch.report.films import Film, draw_overlay
from ndtorch.report.plots import draw_all, draw_timeline
from ndtorch.report.summary import findings, summary
from ndtorch.report.tracks import track_record
from ndtorch.run.result import RunResult
from ndtorch.utils.files import write_text
from ndtorch.utils.signals import figures_wanted
from ndtorch.vision.features import FEATURES

NAME = "report.html"
KINDS = {".png": "image/png", ".jpg": "image/jpeg", ".svg": "image/svg+xml", ".mp4": "video/mp4"}
"""What is embedded, by suffix."""
LARGEST = 24_000_000
"""Bytes of a film that is embedded; a larger one stays beside the page, and the page links it."""


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


def write_page(
    folder: Path,
    title: str,
    answer: Sequence[str],
    facts: Mapping[str, str] = MappingProxyType({}),
    tables: Sequence[Table] = (),
    shown: Sequence[Shown] = (),
    *,
    name: str = NAME,
    used: Sequence[str] = (),
) -> Path:
    """Write a page into a folder, with the command that runs it again; returns the file. Text is escaped.

    Args:
        title: what was looked at.
        answer: what was found, a paragraph each.
        facts: model and the rest, by name; versions follow.
        tables, shown: in the order of the page. Files that are not there are left out.
        used: distributions whose versions are facts too.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    media = []
    for file, *words in shown:
        if file.is_file():
            film, address = file.suffix == ".mp4", file.name
            if not film or file.stat().st_size <= LARGEST:
                address = f"data:{KINDS[file.suffix]};base64,{base64.b64encode(file.read_bytes()).decode()}"
            media.append((film, address, *words))
    program = Path(sys.argv[0]).name
    command = shlex.join(["ndtorch" if program == "__main__.py" else program, *sys.argv[1:]])
    options: dict[str, Any] = {"autoescape": True, "trim_blocks": True, "lstrip_blocks": True}
    loader = FileSystemLoader(Path(__file__).with_name("templates"))
    template = Environment(loader=loader, undefined=StrictUndefined, **options).get_template("page.html")
    said = {
        "title": title,
        "answer": answer,
        "tables": tables,
        "media": media,
        "facts": {**facts, **versions(*used)},
        "command": command,
    }
    write_text(folder / name, template.render(**said))
    return folder / name


def versions(*distributions: str) -> dict[str, str]:
    """Python, the processor and the versions of what was used, as facts of a page."""
    used = {"Python": platform.python_version(), "machine": f"{platform.system()}, {platform.machine()}"}
    for name in ("ndtorch", *distributions, "torch"):
        with contextlib.suppress(PackageNotFoundError):  # a checkout that is on the path
            used[name] = version(name)
    return used


SHOWN = (
    ("poster.jpg", "The objects", "The picture in which most of them are in view."),
    ("objects.jpg", "Each object", "Where it was seen largest, over its number."),
    ("overlay.mp4", "The video, objects marked", "Box or circle in the object's color, its number, its color in words, "
     "and the clock."),
    ("timeline.png", "Objects over time", "Above: a lane an object, thick while it is in sight. Below: where it went."),
    ("enhanced.mp4", "Input and attention", "Left: what the model sees. Right: the same, weighted by the features of "
     "the winning neuron, brightened as far as the input."),
    ("frames.png", "Attention", "Input and enhanced image at the clearest moment of every winner."),
    ("weights.png", "What was learned", "Each column holds the weights from one neuron to all others. Neurons that "
     "own an object have large ones, and their column is the object's list of features."),
    ("outputs.png", "Outputs of the neurons", "A lane a neuron, all to the same scale. Owners are bold. What an owner "
     "inhibits fades as its weight grows."),
)  # fmt: skip
"""Files of a run, their titles and what to see in them."""


def folder_name(name: str) -> str:
    """The name of a source as a folder name: the stem of a path, with nothing but letters, digits, `.`, `_`, `-`."""
    stem = Path(name).stem if "/" in name else name
    return re.sub(r"[^A-Za-z0-9._-]+", "-", stem).strip("-.") or "run"


def write_result(
    result: RunResult, about: Mapping[str, Any], folder: Path, chosen: str, film: Film | None = None
) -> dict[str, Any]:
    """Write objects.json and state.safetensors, the figures and films (of owners, or of tracks) and report.html; after
    SIGTERM without figures.

    Args:
        about: what is needed to go on later.
        chosen: the model in words.
        film: of the source, in which tracks are marked; it is removed.

    Returns:
        The contents of objects.json.
    """
    about = {**about, "frames": about["frames"] + result.frames}
    save_state(result.state, folder / "state.safetensors", {"run": json.dumps(about)})
    tracks = track_record(result) if result.model.tracks else None
    if tracks is not None and tracks.boxed:
        for name, write in FORMATS.items():
            write(tracks, folder / name)
    drawn = figures_wanted()
    if drawn and tracks is None:
        draw_all(result, folder)
    elif drawn and tracks is not None:
        poster = None if film is None else draw_overlay(film, tracks, folder)
        draw_timeline(result, tracks, folder / "timeline.png", poster)
    if film is not None:
        film.path.unlink(missing_ok=True)
    found = summary(result, tracks)
    (folder / "objects.json").write_text(json.dumps(found, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    height, width = result.source.size
    facts = {
        "source": result.source.name,
        "frames": f"{result.frames} of {width} x {height} pixels, {result.simulated_seconds:g} s",
        "model": chosen,
        "time taken": f"{result.wall_seconds:.1f} s",
    }
    rows = []
    for thing in result.objects:
        cells = [f"{thing.features[name]:.2f}" if name in thing.features else "" for name in FEATURES]
        who = thing.neuron if thing.first_seen is None else thing.color
        rows.append([str(thing.number), who, *cells, "" if thing.confidence is None else f"{thing.confidence:.2f}"])
    heads = ("object", "neuron or color", *FEATURES, "confidence")
    remark = "Shares of the strongest; an empty cell: none of it."
    tables = [Table("Features of every object", heads, rows, remark)] if rows else []
    shown = [Shown(folder / name, title, caption) for name, title, caption in SHOWN]
    write_page(folder, f"{result.source.name}: what moves together", findings(result), facts, tables, shown)
    return found
