"""`ndtorch replay`."""

from __future__ import annotations

import contextlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ndtorch.errors import InputError

DIFFERENT, NOT_ALL = 1, 3
"""Exit codes when the frames give other commands than were recorded, and when not all could be compared."""


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

                stream = open_stream(f"replay {self.file.stem}", self.rrd)
                views.append(stack.enter_context(View(stream, runner, print_note, wait=True)))
            compared = replay(recording, runner, views, views[0].report if views else None)
        steps, different = compared.steps, compared.steps - compared.same
        result = asdict(compared) | {"complete": recording.complete, "missing": recording.missing}
        lines = [f"{steps} steps of {self.file} replayed"]
        if not recording.complete:
            lines.append("  the recording was cut short: its end was not written")
        if recording.missing:
            lines.append(f"  {recording.missing} steps are missing or damaged: the navigator saw less")
        same = "the same commands, bit for bit" if steps else "nothing was compared"
        words = f"{different} commands differ, the first in step {compared.first_different}" if different else same
        print(json.dumps(result) if self.json else "\n".join([*lines, f"  {words}"]))
        if self.rrd is not None and (half := why_not_whole(self.rrd)) is not None:
            raise InputError(half)
        if different and not recording.missing:
            return DIFFERENT
        return 0 if steps and recording.complete and not recording.missing else NOT_ALL
