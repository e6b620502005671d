"""`ndtorch barn`."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

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
        from ndtorch_robot.barn import attempt, read_worlds, totals
        from ndtorch_robot.evaluation.drives import drive_many, key_of
        from ndtorch_robot.evaluation.table import markdown

        file = read_worlds(self.file)
        options = RobotOptions(**{name: getattr(self, name) for name in asdict(RobotOptions())})
        jobs = {f"world {w.world}": (file.model_copy(update={"worlds": (w,)}), options) for w in self.chosen(file)}
        how = (lambda job: [job[0].model_dump(), key_of(job[1])]), file.time_limit_s, self.out, self.jobs
        results, exit_code = drive_many(attempt, jobs, *how)
        missing = f"; {len(jobs) - len(results)} of {len(jobs)} worlds are missing" * (len(results) < len(jobs))
        if not results:
            print("{}" if self.json else missing.removeprefix("; "))
            return exit_code
        attempts = pd.DataFrame(results)
        table = totals(attempts)
        text = markdown(table, f"Controller {self.controller}, {self.split} worlds, seed {self.seed}{missing}.")
        attempts.to_csv(self.out / "barn.csv", index=False)
        write_text(self.out / "barn.md", text)
        print(table.iloc[0].to_json() if self.json else f"{text}\nwritten to {self.out}: barn.csv barn.md")
        return exit_code

    def chosen(self, file: BarnFile) -> list[BarnWorld]:
        worlds = [w for w in file.worlds if self.split == "all" or w.is_test == (self.split == "test")]
        missing = sorted(set(self.worlds) - {w.world for w in worlds})
        worlds = [w for w in worlds if not self.worlds or w.world in self.worlds]
        if missing or not worlds:
            what = f"world {missing[0]} among those of --split {self.split}" if missing else "worlds"
            raise InputError(f"{self.file} has no {what}")
        return worlds
