"""What a run leaves in its folder."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ndtorch.binding import save_state
from ndtorch.report.exports import write_exports
from ndtorch.report.figures import draw_all
from ndtorch.report.timeline import draw_timeline, write_timeline
from ndtorch.report.words import summary
from ndtorch.run.result import RunResult


def folder_name(name: str) -> str:
    """The name of a source as a folder name: the stem of a path, with nothing but letters, digits, `.`, `_`, `-`."""
    stem = Path(name).stem if "/" in name else name
    return re.sub(r"[^A-Za-z0-9._-]+", "-", stem).strip("-.") or "run"


def write_result(result: RunResult, about: Mapping[str, Any], folder: Path) -> OSError | None:
    """Write objects.json and state.safetensors, and the figures: of owners, or of tracks over time.

    Args:
        result: of the run.
        about: what is needed to go on later, kept with the state.
        folder: where to write.

    Returns:
        Why there are no figures, where they could not be written: on a full disk the state has to come first.

    Raises:
        OSError: not even the state can be written.
    """
    text = json.dumps(summary(result), indent=2, ensure_ascii=False)
    (folder / "objects.json").write_text(text + "\n", encoding="utf-8")
    about = {**about, "frames": about["frames"] + result.frames}
    save_state(result.state, folder / "state.safetensors", {"run": json.dumps(about)})
    before = set(folder.iterdir())
    try:
        if result.table is None:
            write_timeline(result, folder / "timeline.jsonl")
            write_exports(result, folder)
            draw_timeline(result, folder / "timeline.png")
        else:
            draw_all(result, folder)
    except OSError as error:
        for path in set(folder.iterdir()) - before:
            path.unlink()
        return error
    return None
