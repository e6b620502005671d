"""`python -m robot replay`."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

if TYPE_CHECKING:
    from robot.recording import Recording

DIFFERENT = 1
"""Exit code when lossless frames give other commands than were recorded."""


@dataclass(frozen=True)
class Replay:
    """Drive a recording again and compare the commands.

    The same program runs on the recorded frames and odometry. From lossless frames it must want the same to the
    bit, or the exit code is 1; from JPEG it is said how much it differs. A recording that was cut short is
    replayed as far as it goes.
    """

    folder: Annotated[Path, tyro.conf.Positional]
    """The recording."""
    json: bool = False
    """Print one JSON object and nothing else."""

    def run(self) -> int:
        """Replay, compare, say so."""
        import torch

        from robot.recording import make_pilot, open_recording, replay

        torch.set_num_threads(1)
        recording = open_recording(self.folder)
        comparison = replay(recording, make_pilot(recording.configuration))
        result = asdict(comparison) | {
            "frames": recording.kind,
            "complete": recording.complete,
            "missing": recording.missing,
            "trouble": recording.trouble,
        }
        if self.json:
            print(json.dumps(result))
        else:
            print(describe(recording, result))
        gaps = comparison.skipped or recording.missing
        return DIFFERENT if recording.lossless and not gaps and comparison.same < comparison.steps else 0


def describe(recording: Recording, r: dict[str, Any]) -> str:
    """The comparison in words."""
    lines = [f"{r['steps']} steps of {recording.folder} replayed from {r['frames']} frames"]
    if not r["complete"]:
        lines.append("  the recording was cut short" + (f": {r['trouble']}" if r["trouble"] else ""))
    if r["skipped"] or r["missing"]:
        lines.append(
            f"  {r['skipped']} steps without frames and {r['missing']} lost ones: the navigator saw other things"
        )
    if r["same"] == r["steps"]:
        lines.append("  the same commands, bit for bit")
    else:
        lines.append(
            f"  {r['steps'] - r['same']} commands differ, the first in step {r['first_different']}, by up to "
            f"{r['speed_difference']:.3f} m/s and {r['curvature_difference']:.3f} 1/m"
        )
    return "\n".join(lines)
