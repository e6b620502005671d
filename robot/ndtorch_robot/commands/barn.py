"""`ndtorch barn`."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from ndtorch.errors import InputError
from ndtorch_robot.config import RobotOptions

if TYPE_CHECKING:
    from ndtorch_robot.barn import BarnFile, BarnWorld


@dataclass(frozen=True)
class Barn(RobotOptions):
    """Drive through every world of the BARN challenge once: fields of cylinders, the goal 10 m ahead.

    Success is to come within 1 m of the goal in 100 s without touching anything; the score is success x OT /
    clip(AT, 2 OT, 8 OT), OT the shortest path at 2 m/s and AT the time it took. Writes barn.csv and barn.md,
    and keeps every finished world in DIR/drives: stopped and started again it goes on where it was.
    """

    file: Annotated[Path, tyro.conf.Positional] = Path("barn.json")
    """File of the worlds."""
    split: Literal["all", "tuning", "test"] = "all"
    """Worlds: all, those for tuning, or those for reports, whose numbers are multiples of 5."""
    worlds: tuple[int, ...] = ()
    """Numbers of worlds (default: all of the split)."""
    controller: str = "goal"
    """Controller; only `goal` knows where the goal is."""
    speed: float = 1.0
    """Speed where nothing is in the path, m/s; no robot exceeds that of its table [body]."""
    jobs: int = 0
    """Number of worlds at a time; 0 is one a core."""
    out: Path = Path("out/barn")
    """Folder of the results."""
    json: bool = False
    """Print the totals as one JSON object."""
    goal: Annotated[str, tyro.conf.Suppress] = ""
    explore: Annotated[bool, tyro.conf.Suppress] = False
    return_home: Annotated[bool, tyro.conf.Suppress] = False

    def run(self) -> int:
        import pandas as pd

        from ndtorch.utils.files import write_text
        from ndtorch_robot.barn import Attempt, read_worlds, table, totals
        from ndtorch_robot.evaluation.drives import drive_many, key_of

        file = read_worlds(self.file)
        options = RobotOptions(**{name: getattr(self, name) for name in asdict(RobotOptions())})
        jobs = [(file.model_copy(update={"worlds": (world,)}), options) for world in self.chosen(file)]
        batch = drive_many(
            drive_world,
            jobs,
            lambda job: [job[0].model_dump(), key_of(job[1])],
            lambda job: f"world {job[0].worlds[0].world}",
            lambda job: job[0].time_limit_s,
            self.out,
            processes=self.jobs,
        )
        made = [Attempt(**result) for result in batch.results]
        missing = f"; {batch.missing} of {len(jobs)} worlds are missing" * (batch.missing > 0)
        text = table(made, f"Controller {self.controller}, {self.split} worlds, seed {self.seed}{missing}.")
        pd.DataFrame(made, columns=Attempt._fields).to_csv(batch.folder / "barn.csv", index=False)
        write_text(batch.folder / "barn.md", text)
        print(json.dumps(totals(made)) if self.json else f"{text}\nwritten to {batch.folder}: barn.csv barn.md")
        return batch.exit_code()

    def chosen(self, file: BarnFile) -> list[BarnWorld]:
        worlds = [w for w in file.worlds if self.split == "all" or w.is_test == (self.split == "test")]
        missing = sorted(set(self.worlds) - {w.world for w in worlds})
        worlds = [w for w in worlds if not self.worlds or w.world in self.worlds]
        if missing or not worlds:
            what = f"world {missing[0]} among those of --split {self.split}" if missing else "worlds"
            raise InputError(f"{self.file} has no {what}")
        return worlds


def drive_world(job: tuple[BarnFile, RobotOptions]) -> dict[str, Any]:
    from ndtorch_robot.barn import attempt

    file, options = job
    return attempt(file, file.worlds[0], options)._asdict()
