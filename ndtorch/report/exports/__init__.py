"""What a run found, in formats that other programs read: a format is one file of this folder.

Every format speaks the language of the source: pixels of its frames (upright, before they are made smaller), the number
of a frame as a reader of the source counts, from 1, and the source's own time stamps. A module with `FILE` (the name of
the file) and `write(tracks, path)` is a format; `NEEDS` names the packages that it takes.
"""

from __future__ import annotations

import logging
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

from ndtorch.report.exports.detections import to_detections
from ndtorch.report.exports.source_tracks import SourceTracks, source_tracks
from ndtorch.run.result import RunResult

__all__ = ["SourceTracks", "formats", "source_tracks", "to_detections", "write_exports"]

log = logging.getLogger(__name__)


def formats() -> dict[str, Any]:
    """The modules of the formats, by the names of their files."""
    modules = [import_module(f"{__name__}.{one.name}") for one in iter_modules(__path__)]
    return {module.FILE: module for module in modules if hasattr(module, "FILE")}


def write_exports(result: RunResult, folder: Path, tracks: SourceTracks | None = None) -> None:
    """Write the file of every format, of models whose objects have boxes."""
    if not result.has_boxes:
        return
    tracks = source_tracks(result) if tracks is None else tracks
    for name, module in formats().items():
        missing = [package for package in getattr(module, "NEEDS", ()) if find_spec(package) is None]
        if missing:
            log.info("%s is not written: %s is not installed; pip install 'ndtorch[parquet]'", name, missing[0])
            continue
        module.write(tracks, folder / name)
