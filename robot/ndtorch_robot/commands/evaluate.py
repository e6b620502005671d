"""`ndtorch evaluate`."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated

import tyro

from ndtorch.errors import InputError
from ndtorch_robot.config import DriveConfig

SEEDS = (1000, 1001, 1002)
"""Seeds that nothing was ever tuned on."""


@dataclass(frozen=True)
class Evaluate(DriveConfig):
    """Drive many times, in parallel, and put the results into one table.

    Writes table.md, report.html and drives.jsonl, and keeps every finished drive in DIR/drives:
    killed and started again it goes on where it was, and drives of the same options and code are not driven again.
    Ctrl-C keeps what is finished.
    """

    config: Annotated[Path | None, tyro.conf.Positional] = None
    """TOML file of the options that all drives share, as for `drive`."""
    arenas: tuple[str, ...] = ("buildings",)
    """Arenas: names, .toml files, or the groups buildings, tests and all."""
    seeds: tuple[int, ...] = SEEDS
    """Seeds of buildings, textures and starts; those below 1000 are for tuning, others for reports."""
    controllers: tuple[str, ...] = ()
    """Controllers (default: all)."""
    disturbances: tuple[str, ...] = ()
    """Disturbances in turn: names or KEY=NUMBER as for `drive`, none, or all for each by itself."""
    seconds: float = 300.0
    """Simulated time of each drive, s."""
    jobs: int = 0
    """Number of drives at a time; 0 is one a core."""
    out: Path = Path("out/evaluate")
    """Folder of the results."""
    json: bool = False
    """Print the rows of the table as JSON."""
    arena: Annotated[str, tyro.conf.Suppress] = ""
    seed: Annotated[int, tyro.conf.Suppress] = 0
    controller: Annotated[str, tyro.conf.Suppress] = "ranging"
    disturbance: Annotated[str, tyro.conf.Suppress] = ""
    record: Annotated[Path | None, tyro.conf.Suppress] = None
    rrd: Annotated[Path | None, tyro.conf.Suppress] = None
    view: Annotated[str, tyro.conf.Suppress] = ""

    def run(self) -> int:
        from ndtorch.report.page import Table, write_page
        from ndtorch.utils.files import write_text
        from ndtorch_robot.evaluation.drives import drive_many, drive_once, key_of
        from ndtorch_robot.evaluation.table import markdown, table_of, text_cells

        drives = self.drives()
        results, exit_code = drive_many(drive_once, drives, key_of, self.seconds, self.out, self.jobs)
        missing = f"; {len(drives) - len(results)} of {len(drives)} drives are missing" * (len(results) < len(drives))
        tuned = "; seeds below 1000 were used in tuning" if min(self.seeds) < SEEDS[0] else ""
        note = f"{self.seconds:g} s a drive, seeds {', '.join(map(str, dict.fromkeys(self.seeds)))}{missing}{tuned}."
        write_text(self.out / "drives.jsonl", "".join(json.dumps(result) + "\n" for result in results))
        if not results:
            print("[]" if self.json else note)
            return exit_code
        table = table_of(results)
        text = markdown(table, note)
        write_text(self.out / "table.md", text)
        hours, hits = table["simulated hours"].sum(), sum(result["collisions"] for result in results)
        answer = [f"{len(results)} drives, {hours:.2f} simulated hours, {hits} collisions.", note]
        tables = [Table("All drives together", list(table), text_cells(table))]
        write_page(self.out, "Many drives", answer, tables=tables, used=["ndtorch-robot"])
        written = f"written to {self.out}: table.md drives.jsonl report.html"
        print(table.to_json(orient="records") if self.json else f"{text}\n{written}")
        return exit_code

    def drives(self) -> dict[str, DriveConfig]:
        """The options of all drives by name, checked before the first begins; the seeds vary fastest."""
        from ndtorch.navigation import controller_names
        from ndtorch_robot.sim.arenas import ARENAS, BUILDINGS, TESTS, load_arena
        from ndtorch_robot.sim.disturbances import PRESETS

        if not (self.seeds and self.arenas):
            raise InputError("--seeds and --arenas need one value or more")
        arenas = expanded(self.arenas, buildings=BUILDINGS, tests=TESTS, all=ARENAS)
        disturbances = expanded(self.disturbances or (self.disturbance,), all=("", *PRESETS), none=("",))
        choices = (arenas, disturbances, self.controllers or controller_names(), dict.fromkeys(self.seeds))
        drives = {
            ", ".join(filter(None, (arena, f"seed {seed}", controller, disturbance))): self.single(
                arena=arena, disturbance=disturbance, controller=controller, seed=seed
            )
            for arena, disturbance, controller, seed in product(*choices)
        }
        for arena, seed in product(arenas, self.seeds):
            load_arena(arena, seed)
        return drives


def expanded(words: Iterable[str], **groups: Iterable[str]) -> tuple[str, ...]:
    """Words, with the names of groups replaced by what is in them, each once."""
    return tuple(dict.fromkeys(name for word in words for name in groups.get(word, (word,))))
