"""`ndtorch replay`."""

from __future__ import annotations

import contextlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ndtorch.errors import InputError

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

        from ndtorch.report.recording import why_not_whole
        from ndtorch_robot.ports import print_note
        from ndtorch_robot.recording import make_runner, open_recording, replay

        torch.set_num_threads(1)
        recording = open_recording(self.file)
        runner = make_runner(recording.configuration, mapping=self.rrd is not None)
        with contextlib.ExitStack() as stack:
            views = []
            if self.rrd is not None:
                from ndtorch_robot.view import View, open_stream

                views = [View(open_stream(f"replay {self.file.stem}", self.rrd), runner, print_note, wait=True)]
                stack.callback(views[0].close)
            compared = replay(recording, runner, views, views[0].report if views else None)
        r = asdict(compared) | {"complete": recording.complete, "missing": recording.missing}
        if self.json:
            print(json.dumps(r))
        else:
            print(f"{r['steps']} steps of {self.file} replayed")
            if not r["complete"]:
                print("  the recording was cut short: its end was not written")
            if r["missing"]:
                print(f"  {r['missing']} steps are missing or damaged: the navigator saw less")
            different = f"  {r['steps'] - r['same']} commands differ, the first in step {r['first_different']}"
            same = "  the same commands, bit for bit" if r["steps"] else "  nothing was compared"
            print(same if r["same"] == r["steps"] else different)
        if self.rrd is not None and (half := why_not_whole(self.rrd)) is not None:
            raise InputError(half)
        if not r["missing"] and r["same"] < r["steps"]:
            return DIFFERENT
        return NOT_ALL if r["missing"] or not r["complete"] or not r["steps"] else 0
