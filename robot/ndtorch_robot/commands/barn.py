"""`ndtorch barn`."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from ndtorch.cli.command_run import INTERRUPTED
from ndtorch.errors import InputError
from ndtorch_robot.navigator_options import navigator_options

if TYPE_CHECKING:
    from collections.abc import Callable

    from ndtorch_robot.barn import BarnWorld, Entry

FAILED = 1
"""Exit code when some world could not be driven."""


@dataclass(frozen=True)
@navigator_options("controller", "speed", "goal", "explore", "return_home")
class Barn:
    """Drive through every world of the BARN challenge once: fields of cylinders, the goal 10 m ahead.

    Success is to come within 1 m of the goal in 100 s without touching anything; the score is success x OT /
    clip(AT, 2 OT, 8 OT), OT the shortest path at 2 m/s and AT the time it took. Writes barn.csv and barn.md,
    and keeps every finished world in DIR/worlds: stopped and started again it goes on where it was.
    """

    file: Annotated[Path, tyro.conf.Positional]
    """File of the worlds, barn.json."""
    split: Literal["all", "tuning", "test"] = "all"
    """Worlds: all, those for tuning, or those for reports, whose numbers are multiples of 5."""
    worlds: tuple[int, ...] = ()
    """Numbers of worlds (default: all of the split)."""
    controller: str = "goal"
    """Controller; only `goal` knows where the goal is."""
    robot: Path | None = None
    """Configuration of a robot, a file or one of robot/configs by name (default: the car of [A])."""
    speed: float = 1.0
    """Speed where nothing is in the path, m/s; no robot exceeds that of its table [body]."""
    seed: int = 0
    """Seed of the textures of cylinders and floor."""
    jobs: int = 0
    """Number of worlds at a time; 0 is one a core."""
    out: Path = Path("out/barn")
    """Folder of the results; barn-2, and so on, with other options or code."""
    force: bool = False
    """Write into that folder whatever is in it."""
    json: bool = False
    """Print the totals as one JSON object."""

    def run(self) -> int:
        from ndtorch.run.folder import place_for
        from ndtorch.utils.files import write_text
        from ndtorch_robot.barn import Attempt, attempt_name, comma_separated, table, totals
        from ndtorch_robot.evaluation.drives import ResultCache, finish, processes_of

        worlds, processes = self.chosen(), processes_of(self.jobs)
        entries = [self.entry(world) for world in worlds]
        cache = ResultCache(Path(), attempt_name)
        place = place_for(self.out, {"command": "barn", "attempts": sorted(map(cache.name, entries))}, force=self.force)
        place.take_over("worlds")
        out, cache.folder = place.folder, place.folder / "worlds"
        troubles, interrupted = list[str](), False
        try:
            troubles = finish(drive_world, entries, cache, processes, "world {0.world.number}".format, unit=" worlds")
        except KeyboardInterrupt:
            interrupted = True
        made = [Attempt(**result) for entry in entries if (result := cache.get(entry)) is not None]
        missing = f"; {len(worlds) - len(made)} of {len(worlds)} worlds are missing" * (len(made) < len(worlds))
        text = table(made, f"Controller {self.controller}, {self.split} worlds, seed {self.seed}{missing}.")
        write_text(out / "barn.csv", comma_separated(made))
        write_text(out / "barn.md", text)
        print(json.dumps(totals(made)) if self.json else f"{text}\nwritten to {out}: barn.csv barn.md")
        for trouble in troubles:
            print(f"failed: {trouble}", file=sys.stderr)
        return INTERRUPTED if interrupted else FAILED if troubles else 0

    def chosen(self) -> list[BarnWorld]:
        from ndtorch_robot.barn import read_worlds

        worlds = [w for w in read_worlds(self.file) if self.split == "all" or w.is_test == (self.split == "test")]
        missing = sorted(set(self.worlds) - {w.number for w in worlds})
        worlds = [w for w in worlds if not self.worlds or w.number in self.worlds]
        if missing or not worlds:
            what = f"world {missing[0]} among those of --split {self.split}" if missing else "worlds"
            raise InputError(f"{self.file} has no {what}")
        return worlds

    def entry(self, world: BarnWorld) -> Entry:
        from ndtorch.navigation.options import OPTION_NAMES, options_of
        from ndtorch_robot.barn import Entry
        from ndtorch_robot.config import read_robot

        given = {k: v for k, v in asdict(self).items() if k in OPTION_NAMES and v is not None and v is not False}
        return Entry(world, options_of(given), self.seed, None if self.robot is None else read_robot(self.robot)[0])


def drive_world(entry: Entry, note: Callable[[float], None]) -> dict[str, Any]:
    import torch

    from ndtorch_robot.barn import attempt

    torch.set_num_threads(1)
    return attempt(entry)._asdict()
