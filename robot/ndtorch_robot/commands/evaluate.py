"""`ndtorch evaluate`."""

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
    from ndtorch_robot.config import DriveConfig
    from ndtorch_robot.evaluation.drives import Summary

SEEDS = (1000, 1001, 1002)
"""Seeds that nothing was ever tuned on."""

SECONDS = 300.0
"""Simulated time of a drive, unless the user says otherwise."""

FAILED = 1
"""Exit code when some drive could not be done."""


@dataclass(frozen=True)
@navigator_options("controller")
class Evaluate:
    """Drive many times, in parallel, and put the results into one table.

    Writes report.html, table.md, table.csv, table.png and drives.jsonl, and keeps every finished drive in DIR/drives:
    killed and started again it goes on where it was. With other options or other code it writes into a new folder,
    evaluate-2, and takes over the drives that are the same. Ctrl-C keeps what is finished.
    """

    config: Annotated[Path | None, tyro.conf.Positional] = None
    """The options that all drives share may be keys of this TOML file, as for `drive`."""
    robot: Path | None = None
    """The robot of this file drives, as with `drive`."""
    arenas: tuple[str, ...] = ()
    """The car drives in these arenas: names, .toml files, or the groups buildings (default), tests and all."""
    seeds: tuple[int, ...] = SEEDS
    """Buildings, textures and starts follow from these numbers; those below 1000 are for tuning, others for reports."""
    seconds: float | None = None
    """Each drive takes this simulated time, in s (default: 300)."""
    controllers: tuple[str, ...] = ()
    """The controllers of these names steer (default: all)."""
    walls: tuple[Literal["textured", "blank"], ...] = ("textured",)
    """Walls have panels, doors and papers, no texture at all, or both in turn."""
    disturbance: tuple[str, ...] = ()
    """These disturbances act in turn: names or KEY=NUMBER as of `drive`, none, or all for each by itself."""
    pedestrian: bool = False
    """A box of the size of a person walks to and fro."""
    jobs: int = 0
    """This number of drives runs at a time; 0 is one a core."""
    out: Path = Path("out/evaluate")
    """Results are written into this folder."""
    force: bool = False
    """Results are written into this folder whatever is in it."""
    open: bool = False
    """The browser shows report.html when it is written."""
    json: bool = False
    """The rows of the table are printed as JSON."""

    def run(self) -> int:
        from ndtorch.report.page import NAME, open_in_browser
        from ndtorch.run.folder import place_for
        from ndtorch_robot.evaluation.drives import DriveCache, drive_once, finish, processes_of

        drives, processes = self.drives(), processes_of(self.jobs)
        place = place_for(self.out, settings_of(drives), force=self.force)
        place.take_over("drives")
        out = place.folder
        cache = DriveCache(out / "drives")
        troubles: list[str] = []
        interrupted = False
        try:
            form = "{desc} {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} s, {rate_fmt}, {remaining} left"
            look = {"unit": "x", "bar_format": form}
            troubles = finish(drive_once, drives, cache, processes, name_of, lambda d: d.seconds, **look)
        except KeyboardInterrupt:
            interrupted = True
        found = [(d, summary) for d in drives if (summary := cache.get(d)) is not None]
        words = write_tables([summary for _, summary in found], out, self.note(drives, found), self.json)
        print(words)
        if self.open and found:
            open_in_browser(out / NAME)
        for trouble in troubles:
            print(f"failed: {trouble}", file=sys.stderr)
        return INTERRUPTED if interrupted else FAILED if troubles else 0

    def drives(self) -> list[DriveConfig]:
        """The configurations of all drives, checked before the first begins."""
        from ndtorch.navigation import controller_names
        from ndtorch.navigation.options import OPTION_NAMES
        from ndtorch_robot.config import load_config
        from ndtorch_robot.evaluation.drives import all_drives
        from ndtorch_robot.sim.arenas import load_arena

        arenas = arenas_of(self.arenas or ("buildings",))
        controllers = self.controllers or controller_names()
        if not (self.seeds and self.walls):
            raise InputError("--seeds and --walls need one value or more")
        given = {
            name: value
            for name, value in asdict(self).items()
            if (name in OPTION_NAMES or name in ("pedestrian", "robot")) and value is not False
        }
        base = load_config(self.config, {"seconds": self.seconds, "seed": self.seeds[0], **given})
        if "seconds" not in base.model_fields_set:
            base = base.model_copy(update={"seconds": SECONDS})
        for controller in controllers:
            load_config(None, {"controller": controller})
        for seed in self.seeds:
            load_config(None, {"seed": seed})
        disturbances = disturbances_of(self.disturbance)
        for disturbance in disturbances or ():
            load_config(None, {"disturbance": disturbance})
        drives = all_drives(base, arenas, self.walls, controllers, list(self.seeds), disturbances)
        for arena in arenas:
            for seed in self.seeds:
                load_arena(arena, seed)
        return drives

    def note(self, drives: list[DriveConfig], found: list[Any]) -> str:
        seeds = ", ".join(str(seed) for seed in dict.fromkeys(self.seeds))
        missing = f"; {len(drives) - len(found)} of {len(drives)} drives are missing" * (len(found) < len(drives))
        tuned = "; seeds below 1000 were used in tuning" if min(self.seeds) < SEEDS[0] else ""
        return f"{drives[0].seconds:g} s a drive, seeds {seeds}{missing}{tuned}."


def settings_of(drives: list[DriveConfig]) -> dict[str, Any]:
    """What the table will be of: every drive by the name of its result, which stands for its options and the code."""
    from ndtorch_robot.evaluation.drives import DriveCache

    named = DriveCache(Path())
    words = {named.name(d): f"{d.arena}, seed {d.seed}, {d.walls}, {d.controller}" for d in drives}
    return {"command": "evaluate", "drives": words}


def arenas_of(given: tuple[str, ...]) -> tuple[str, ...]:
    """Names of arenas, with the words for groups replaced by what is in them."""
    from ndtorch_robot.sim.arenas import ARENAS, BUILDINGS, TESTS

    if "trials" in given:
        raise InputError("the arenas 'trials' are called 'tests' now")
    groups = {"buildings": BUILDINGS, "tests": TESTS, "all": ARENAS}
    return tuple(dict.fromkeys(name for word in given for name in groups.get(word, (word,))))


def disturbances_of(given: tuple[str, ...]) -> tuple[str, ...] | None:
    """Disturbances, with "all" replaced by none and every single one; None where nothing is given."""
    from ndtorch_robot.sim.disturbances import PRESETS

    words = {"all": ("", *PRESETS), "none": ("",)}
    return tuple(dict.fromkeys(name for word in given for name in words.get(word, (word,)))) or None


def name_of(config: DriveConfig) -> str:
    words = (config.arena, f"seed {config.seed}", config.walls, config.controller, config.disturbance)
    return ", ".join(filter(None, words))


def write_tables(summaries: list[Summary], folder: Path, note: str, as_json: bool) -> str:
    """All files of an evaluation; returns what to print."""
    from ndtorch.report.plots import save
    from ndtorch.utils.files import replacing, write_text
    from ndtorch_robot.evaluation.plots import table_plot
    from ndtorch_robot.evaluation.report import write_evaluation_page
    from ndtorch_robot.evaluation.table import comma_separated, markdown, rows_of

    rows = rows_of(summaries)
    text = markdown(rows, note)
    write_text(folder / "table.md", text)
    write_text(folder / "table.csv", comma_separated(rows))
    write_text(folder / "drives.jsonl", "".join(json.dumps(s) + "\n" for s in summaries))
    if rows:
        with replacing(folder / "table.png") as beside:
            save(table_plot(rows), beside)
        write_evaluation_page(rows, note, folder)
    if as_json:
        return json.dumps([{k: v for k, v in row.items() if k != "drives"} for row in rows])
    return text + f"\nwritten to {folder}: table.md table.csv drives.jsonl" + " table.png report.html" * bool(rows)
