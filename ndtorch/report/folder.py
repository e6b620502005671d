"""The folder of a run: all of its files or none."""

from __future__ import annotations

import json
import re
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ndtorch.binding import save_state
from ndtorch.errors import InputError
from ndtorch.report.figures import draw_all
from ndtorch.report.timeline import draw_timeline, write_timeline
from ndtorch.report.words import summary
from ndtorch.run.result import RunResult


class OutputFolder:
    """A result folder that appears complete or not at all: files are written beside it and moved in at the end."""

    def __init__(self, parent: Path, name: str) -> None:
        self.final = parent / name
        try:
            self.final.mkdir(parents=True, exist_ok=True)
            self.work = Path(tempfile.mkdtemp(prefix=f".{name}-", dir=parent))
        except OSError as error:
            raise InputError(f"--out {parent} cannot be written: {error.strerror}") from None

    def publish(self) -> list[Path]:
        """Move everything in; returns the files."""
        moved = [path.replace(self.final / path.name) for path in sorted(self.work.iterdir())]
        self.work.rmdir()
        return moved

    def discard(self) -> None:
        """Drop what was written, and the folder if nothing was in it."""
        shutil.rmtree(self.work, ignore_errors=True)
        if not any(self.final.iterdir()):
            self.final.rmdir()


def folder_name(name: str) -> str:
    """The name of a source as a folder name: the stem of a path, with nothing but letters, digits, `.`, `_`, `-`."""
    stem = Path(name).stem if "/" in name else name
    return re.sub(r"[^A-Za-z0-9._-]+", "-", stem).strip("-.") or "run"


def write_result(result: RunResult, about: Mapping[str, Any], folder: Path) -> None:
    """Write objects.json and state.safetensors, and the figures: of owners, or of tracks over time.

    Args:
        result: of the run.
        about: what is needed to go on later, kept with the state.
        folder: where to write.
    """
    text = json.dumps(summary(result), indent=2, ensure_ascii=False)
    (folder / "objects.json").write_text(text + "\n", encoding="utf-8")
    about = {**about, "frames": about["frames"] + result.frames}
    save_state(result.state, folder / "state.safetensors", {"run": json.dumps(about)})
    if result.table is None:
        write_timeline(result, folder / "timeline.jsonl")
        draw_timeline(result, folder / "timeline.png")
    else:
        draw_all(result, folder)
