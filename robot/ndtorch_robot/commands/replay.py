"""`ndtorch replay`."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from ndtorch.errors import InputError

if TYPE_CHECKING:
    from ndtorch_robot.recording import Comparison, Recording

DIFFERENT = 1
"""Exit code when the frames give other commands than were recorded."""

NOT_ALL = 3
"""Exit code when the commands are the same as far as they could be compared, and not all could be."""


@dataclass(frozen=True)
class Replay:
    """Drive a recording again and compare the commands.

    The same program runs on the recorded frames and odometry, and must want the same to the bit, or the exit code is 1.
    A recording that was cut short or is damaged is replayed as far as it can be, with exit code 3.
    """

    file: Annotated[Path, tyro.conf.Positional]
    """Recording, NAME.mcap."""
    rrd: Path | None = None
    """File of the rerun viewer for the replay."""
    json: bool = False
    """Print the result as one JSON object and nothing else."""

    def run(self) -> int:
        import torch

        from ndtorch_robot.recording import make_runner, open_recording, replay

        torch.set_num_threads(1)
        recording = open_recording(self.file)
        if self.rrd is None:
            comparison = replay(recording, make_runner(recording.configuration))
        else:
            comparison = shown(recording, self.rrd)
        names = ("complete", "missing", "damaged")
        result = asdict(comparison) | {name: getattr(recording, name) for name in names}
        print(json.dumps(result) if self.json else describe(recording, result))
        if self.rrd is not None:
            from ndtorch.report.recording import why_not_whole

            half = why_not_whole(self.rrd)
            if half is not None:
                raise InputError(half)
        gaps = bool(recording.missing or recording.damaged)
        if not gaps and comparison.same < comparison.steps:
            return DIFFERENT
        return NOT_ALL if gaps or not recording.complete or not comparison.steps else 0


def shown(recording: Recording, rrd: Path) -> Comparison:
    from ndtorch_robot.ports import print_note
    from ndtorch_robot.recording import make_runner, replay
    from ndtorch_robot.view import View, open_stream

    runner = make_runner(recording.configuration, mapping=True)
    stream = open_stream(f"replay {recording.path.stem}", rrd)
    view = View(stream, runner, print_note, wait=True)
    try:
        return replay(recording, runner, [view], view.report)
    finally:
        view.close()


def describe(recording: Recording, r: dict[str, Any]) -> str:
    lines = [f"{r['steps']} steps of {recording.path} replayed"]
    if not r["complete"]:
        lines.append("  the recording was cut short: its end was not written")
    if r["damaged"] or r["missing"]:
        lines.append(f"  {r['damaged']} chunks or steps are damaged and {r['missing']} missing: the navigator saw less")
    if not r["steps"]:
        lines.append("  nothing was compared")
    elif r["same"] == r["steps"]:
        lines.append("  the same commands, bit for bit")
    else:
        lines.append(f"  {r['steps'] - r['same']} commands differ, the first in step {r['first_different']}")
    return "\n".join(lines)
