"""`ndtorch soak`."""

from __future__ import annotations

import gc
import json
import secrets
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from ndtorch.errors import InputError

FAILED = 1
"""Exit code when something was not as it must be."""

CODE = ("ndtorch", "ndtorch_robot")


@dataclass(frozen=True)
class Soak:
    """Drive for hours in simulated time while cameras, link, disk and computer fail by chance.

    The loop, the safety layer, the link and the board's own code are those of a car. Every stop must have a fault that
    explains it, every fault that must stop the wheels must do so in time, and the memory must not grow. The time of
    the wheels is measured by the pulses of the board. It needs a C compiler.

    Keeps every finished piece in DIR: stopped and started again it goes on where it was, and a longer one begins with
    what a shorter one drove. Exit code 1 when something was not as it must be.
    """

    config: Annotated[Path, tyro.conf.Positional] = Path("sim")
    """TOML file of the car, or the name of one that comes along; its cameras and its link are replaced."""
    minutes: float = 10.0
    """Simulated time in all."""
    piece: float = 180.0
    """Simulated time of one piece, s; each drives in another building."""
    first: int = 0
    """Number of the first piece. Each number has its own building, faults and times: choose one that nobody drove."""
    out: Path = Path("out/soak")
    """Folder for the pieces and the table; of another car, with other pieces or other code soak-2, and so on."""
    force: bool = False
    """Write into this folder whatever is in it."""
    json: bool = False
    """Print the figures as one JSON object and nothing else on stdout."""

    def run(self) -> int:
        """Drive the pieces that are missing, write the table."""
        import torch

        from ndtorch.code_digest import code_digest
        from ndtorch.ending import parts_kept
        from ndtorch.files import write_text
        from ndtorch.installed import toml_file
        from ndtorch.run.folder import place_for
        from ndtorch.toml import read_toml
        from ndtorch_robot.run_config import RunConfig
        from ndtorch_robot.sim.hosted_board import HostedBoard
        from ndtorch_robot.soak.piece import drive_piece, resident_megabytes
        from ndtorch_robot.soak.table import report, summary, troubles

        if not 10 <= self.piece <= 3600 or not 0 < self.minutes < 1e6:
            raise InputError(
                f"--minutes must be positive and --piece 10 to 3600 s, got {self.minutes:g} and {self.piece:g}"
            )
        if not 0 <= self.first < 1_000_000:
            raise InputError(f"--first must be 0 to 999999, got {self.first}")
        config = read_toml(toml_file(self.config, "ndtorch_robot", "configs"), RunConfig)
        torch.set_num_threads(1)
        key = {"code": code_digest(CODE, ("torch", "mujoco", "numpy")), "config": config.model_dump_json()}
        key |= {"piece": f"{self.piece:g}", "board": HostedBoard.code()}
        place = place_for(self.out, {"command": "soak"} | key, force=self.force)
        numbers = range(self.first, self.first + max(1, round(60 * self.minutes / self.piece)))
        files = [place.folder / f"piece-{number:04d}.json" for number in numbers]
        # A shorter soak than the last one leaves nothing out that was driven.
        every = sorted({*files, *place.folder.glob("piece-*.json")})
        known = {file: made for file in every if (made := kept(file, key)) is not None}
        process, pieces = secrets.token_hex(4), list(known.values())
        with parts_kept(place.folder, "pieces", len(files), lambda: sum(file in known for file in files)):
            for number, file in zip(numbers, files, strict=True):
                made = known.get(file)
                if made is None:
                    made = drive_piece(config, number, self.piece, lambda seconds: None)
                    gc.collect()
                    made |= {"process": process, "megabytes": round(resident_megabytes(), 1), "key": key}
                    write_text(file, json.dumps(made) + "\n")
                    known[file] = made
                    pieces = [known[each] for each in sorted(known)]
                for line in troubles([made]):
                    print(line, file=sys.stderr, flush=True)
                print(f"piece {number}: {summary([made])}", file=sys.stderr, flush=True)
                write_text(place.folder / "table.md", report(pieces))
        print(json.dumps(summary(pieces)) if self.json else report(pieces))
        return FAILED if troubles(pieces) else 0


def kept(file: Path, key: dict[str, str]) -> dict[str, Any] | None:
    """A piece that was driven before by the same code in the same way; None where there is none."""
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) and found.get("key") == key else None
