"""`ndtorch evaluate`."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from ndtorch.cli.command_run import INTERRUPTED
from ndtorch.errors import InputError
from ndtorch_robot.navigator_options import navigator_options

if TYPE_CHECKING:
    from ndtorch_robot.config import DriveConfig

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

    Writes report.html, table.md and drives.jsonl, and keeps every finished drive in DIR/drives:
    killed and started again it goes on where it was. With other options or other code it writes into a new folder,
    evaluate-2, and takes over the drives that are the same. Ctrl-C keeps what is finished.
    """

    config: Annotated[Path | None, tyro.conf.Positional] = None
    """TOML file of the options that all drives share, as for `drive`."""
    robot: Path | None = None
    """Configuration of a robot, as for `drive`."""
    arenas: tuple[str, ...] = ()
    """Arenas: names, .toml files, or the groups buildings (default), tests and all."""
    seeds: tuple[int, ...] = SEEDS
    """Seeds of buildings, textures and starts; those below 1000 are for tuning, others for reports."""
    seconds: float | None = None
    """Simulated time of each drive, s (default: 300)."""
    controllers: tuple[str, ...] = ()
    """Controllers (default: all)."""
    walls: tuple[Literal["textured", "blank"], ...] = ("textured",)
    """Walls: with panels, doors and papers, without texture, or both in turn."""
    disturbance: tuple[str, ...] = ()
    """Disturbances in turn: names or KEY=NUMBER as for `drive`, none, or all for each by itself."""
    pedestrian: bool = False
    """Add a person who walks to and fro."""
    jobs: int = 0
    """Number of drives at a time; 0 is one a core."""
    out: Path = Path("out/evaluate")
    """Folder of the results."""
    force: bool = False
    """Write into that folder whatever is in it."""
    open: bool = False
    """Open report.html in the browser at the end."""
    json: bool = False
    """Print the rows of the table as JSON."""

    def run(self) -> int:
        from ndtorch.report.page import NAME, open_in_browser
        from ndtorch.run.folder import place_for
        from ndtorch_robot.evaluation.drives import ResultCache, drive_once, finish, key_of, processes_of

        drives, processes = self.drives(), processes_of(self.jobs)
        cache = ResultCache(Path(), key_of)
        settings = {"command": "evaluate", "drives": {cache.name(drive): name_of(drive) for drive in drives}}
        place = place_for(self.out, settings, force=self.force)
        place.take_over("drives")
        out, cache.folder = place.folder, place.folder / "drives"
        troubles, interrupted = list[str](), False
        try:
            form = "{desc} {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} s, {rate_fmt}, {remaining} left"
            look = {"unit": "x", "bar_format": form}
            troubles = finish(drive_once, drives, cache, processes, name_of, lambda d: d.seconds, **look)
        except KeyboardInterrupt:
            interrupted = True
        summaries = [summary for drive in drives if (summary := cache.get(drive)) is not None]
        left = len(drives) - len(summaries)
        missing = f"; {left} of {len(drives)} drives are missing" if left else ""
        tuned = "; seeds below 1000 were used in tuning" if min(self.seeds) < SEEDS[0] else ""
        seeds = ", ".join(str(seed) for seed in dict.fromkeys(self.seeds))
        note = f"{drives[0].seconds:g} s a drive, seeds {seeds}{missing}{tuned}."
        print(write_tables(summaries, out, note, self.json))
        if self.open and summaries:
            open_in_browser(out / NAME)
        for trouble in troubles:
            print(f"failed: {trouble}", file=sys.stderr)
        return INTERRUPTED if interrupted else FAILED if troubles else 0

    def drives(self) -> list[DriveConfig]:
        """The configurations of all drives, checked before the first begins; the seeds vary fastest."""
        from ndtorch.navigation import controller_names
        from ndtorch.navigation.options import OPTION_NAMES
        from ndtorch.utils.toml import toml_values
        from ndtorch_robot.config import load_config
        from ndtorch_robot.sim.arenas import ARENAS, BUILDINGS, TESTS, load_arena
        from ndtorch_robot.sim.disturbances import PRESETS

        if not (self.seeds and self.walls):
            raise InputError("--seeds and --walls need one value or more")
        in_file = toml_values(self.config) if self.config is not None else {}
        shared = {
            name: value
            for name, value in asdict(self).items()
            if (name in OPTION_NAMES or name in ("pedestrian", "robot")) and value is not False
        }
        seconds = in_file.get("seconds", SECONDS) if self.seconds is None else self.seconds
        arenas = expanded(self.arenas or ("buildings",), buildings=BUILDINGS, tests=TESTS, all=ARENAS)
        disturbances = expanded(self.disturbance or (in_file.get("disturbance", ""),), all=("", *PRESETS), none=("",))
        names = ("arena", "walls", "disturbance", "controller", "seed")
        choices = (arenas, self.walls, disturbances, self.controllers or controller_names(), self.seeds)
        drives = [
            load_config(self.config, {**shared, "seconds": seconds, **dict(zip(names, values, strict=True))})
            for values in dict.fromkeys(product(*choices))
        ]
        for arena, seed in product(arenas, self.seeds):
            load_arena(arena, seed)
        return drives


def expanded(words: tuple[str, ...], **groups: Any) -> tuple[str, ...]:
    """Words, with the names of groups replaced by what is in them, each once."""
    return tuple(dict.fromkeys(name for word in words for name in groups.get(word, (word,))))


def name_of(config: DriveConfig) -> str:
    words = (config.arena, f"seed {config.seed}", config.walls, config.controller, config.disturbance)
    return ", ".join(filter(None, words))


def write_tables(summaries: list[dict[str, Any]], folder: Path, note: str, as_json: bool) -> str:
    """All files of an evaluation; returns what to print."""
    from ndtorch.report.page import Page, Table, command_line, versions
    from ndtorch.utils.files import write_text
    from ndtorch_robot.evaluation.table import markdown, rows_of, text_cells

    rows = rows_of(summaries)
    text = markdown(rows, note)
    write_text(folder / "table.md", text)
    write_text(folder / "drives.jsonl", "".join(json.dumps(s) + "\n" for s in summaries))
    if rows:
        hours, hits = sum(row["hours"] for row in rows), sum(summary["collisions"] for summary in summaries)
        answer = [f"{len(summaries)} drives, {hours:.2f} simulated hours, {hits} collisions.", note]
        table = Table("All drives together", *text_cells(rows))
        Page("Many drives", answer, command_line(), versions("ndtorch-robot"), [table]).write(folder)
    if as_json:
        return json.dumps([{k: v for k, v in row.items() if k != "drives"} for row in rows])
    return f"{text}\nwritten to {folder}: table.md drives.jsonl" + " report.html" * bool(rows)
