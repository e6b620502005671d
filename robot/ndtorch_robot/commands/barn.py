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
    from collections.abc import Callable, Sequence

    from ndtorch_robot.barn.attempts import Attempt, Entry
    from ndtorch_robot.barn.worlds import World

FAILED = 1
"""Exit code when some world could not be driven."""


@dataclass(frozen=True)
@navigator_options("controller", "speed", "goal", "explore", "return_home")
class Barn:
    """Drive through every world of the BARN challenge once: fields of cylinders, the goal 10 m ahead.

    Success is to come within 1 m of the goal in 100 s without touching anything; the score is success x OT /
    clip(AT, 2 OT, 8 OT), OT the shortest path at 2 m/s and AT the time it took. Writes barn.csv, barn.md and barn.png,
    and keeps every finished world in DIR/worlds: stopped and started again it goes on where it was.
    """

    file: Annotated[Path, tyro.conf.Positional]
    """The worlds are read from this file, barn.json."""
    split: Literal["all", "tuning", "test"] = "all"
    """The car drives in all worlds, in those for tuning, or in those for reports, whose numbers are multiples of 5."""
    worlds: tuple[int, ...] = ()
    """The car drives only in the worlds of these numbers."""
    controller: str = "goal"
    """The controller of this name steers; only `goal` knows where the goal is."""
    robot: Path | None = None
    """The robot of this file drives, or one of robot/configs by name (default: the car of [A])."""
    speed: float = 1.0
    """The car drives at this speed where nothing is in its path, m/s; no robot exceeds that of its table [body]."""
    moving_cylinders: int = 0
    """This number of cylinders moves to and fro at .2 to .8 m/s, and meets the car from ahead, beside and behind."""
    plain_cylinders: bool = False
    """Moving cylinders are in plain checks, not textured as those that stand."""
    seed: int = 0
    """Seed of the textures of cylinders and floor, and of moving cylinders."""
    jobs: int = 0
    """This number of worlds is driven at a time; 0 is one a core."""
    out: Path = Path("out/barn")
    """Results are written into this folder, and into barn-2, and so on, with other options or code."""
    force: bool = False
    """Results are written into this folder whatever is in it."""
    json: bool = False
    """The totals are printed as one JSON object."""

    def run(self) -> int:
        from ndtorch.run.folder import place_for
        from ndtorch_robot.barn.attempts import AttemptCache
        from ndtorch_robot.evaluation.drives import finish, processes_of

        worlds, processes = self.chosen(), processes_of(self.jobs)
        entries = [self.entry(world) for world in worlds]
        if self.moving_cylinders < 0:
            raise InputError(f"--moving-cylinders must be 0 or more, got {self.moving_cylinders}")
        names = sorted(AttemptCache(Path()).name(entry) for entry in entries)
        place = place_for(self.out, {"command": "barn", "attempts": names}, force=self.force)
        place.take_over("worlds")
        cache = AttemptCache(place.folder / "worlds")
        troubles: list[str] = []
        interrupted = False
        try:
            named = "world {0.world.number}".format
            troubles = finish(drive_world, entries, cache, processes, named, unit=" worlds")
        except KeyboardInterrupt:
            interrupted = True
        made = [found for e in entries if (found := cache.attempt(e)) is not None]
        print(self.write(worlds, made, place.folder))
        for trouble in troubles:
            print(f"failed: {trouble}", file=sys.stderr)
        return INTERRUPTED if interrupted else FAILED if troubles else 0

    def chosen(self) -> list[World]:
        from ndtorch_robot.barn.worlds import read_worlds

        worlds = [w for w in read_worlds(self.file) if self.split == "all" or w.is_test == (self.split == "test")]
        missing = sorted(set(self.worlds) - {w.number for w in worlds})
        if missing:
            raise InputError(f"{self.file} has no world {missing[0]} among those of --split {self.split}")
        worlds = [w for w in worlds if not self.worlds or w.number in self.worlds]
        if not worlds:
            raise InputError(f"{self.file} has no worlds")
        return worlds

    def entry(self, world: World) -> Entry:
        from ndtorch.navigation.options import OPTION_NAMES, options_of
        from ndtorch_robot.barn.attempts import Entry
        from ndtorch_robot.barn.moving import moving_cylinders
        from ndtorch_robot.config import read_robot

        given = {k: v for k, v in asdict(self).items() if k in OPTION_NAMES and v is not None and v is not False}
        robot = None if self.robot is None else read_robot(self.robot)[0]
        movers = moving_cylinders(world, self.moving_cylinders, self.seed)
        return Entry(world, options_of(given), self.seed, robot, movers, self.plain_cylinders)

    def write(self, worlds: Sequence[World], made: Sequence[Attempt], out: Path) -> str:
        from ndtorch.report.plots.layout import save
        from ndtorch.utils.files import replacing, write_text
        from ndtorch_robot.barn.attempts import comma_separated, table, totals
        from ndtorch_robot.evaluation.plots import barn_plot

        missing = f"; {len(worlds) - len(made)} of {len(worlds)} worlds are missing" * (len(made) < len(worlds))
        plain = " plain" * self.plain_cylinders
        moving = f", {self.moving_cylinders}{plain} moving cylinders" * (self.moving_cylinders > 0)
        note = f"Controller {self.controller}, {self.split} worlds{moving}, seed {self.seed}{missing}."
        text = table(made, note)
        write_text(out / "barn.csv", comma_separated(made))
        write_text(out / "barn.md", text)
        if made:
            with replacing(out / "barn.png") as beside:
                save(barn_plot(worlds, made), beside)
        if self.json:
            return json.dumps(totals(made))
        return text + f"\nwritten to {out}: barn.csv barn.md" + " barn.png" * bool(made)


def drive_world(entry: Entry, note: Callable[[float], None]) -> dict[str, Any]:
    import torch

    from ndtorch_robot.barn.attempts import attempt

    torch.set_num_threads(1)
    return attempt(entry)._asdict()
