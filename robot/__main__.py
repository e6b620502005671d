"""Command line of the robot: `python -m robot drive` and `python -m robot arenas`."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from ndtorch.errors import InputError

if TYPE_CHECKING:
    from robot.config import DriveConfig
    from robot.drive import Result

INTERRUPTED = 130


@dataclass(frozen=True)
class Drive:
    """Drive through a simulated building, steering and mapping by sight.

    Shows the progress and a summary, and writes summary.json, path.png, map.png, map.npz, speeds.png and rows.png.
    Options override the file. Ctrl-C stops the robot and keeps everything.
    """

    config: Annotated[Path | None, tyro.conf.Positional] = None
    """TOML file with the options below as keys."""
    arena: str | None = None
    """Arena by name (see `python -m robot arenas`), or a .toml file (default hallway)."""
    seed: int | None = None
    """Building, textures and starting place (default 0)."""
    seconds: float | None = None
    """Simulated time to drive, s (default 60)."""
    controller: str | None = None
    """What steers: published, the saccades of the paper (default)."""
    features: int | None = None
    """Features to range in each frame (default 5)."""
    angle: Literal["atan", "linear"] | None = None
    """Angle of a pixel: exact (atan, default) or the paper's straight line."""
    odometry: Literal["true", "noisy"] | None = None
    """Dead reckoning: exact (default), or 1 % too long and drifting by 0.05 degrees a second."""
    walls: Literal["textured", "blank"] | None = None
    """Walls with panels, doors and papers (default), or without any texture."""
    moving: bool = False
    """With a person-sized box that walks to and fro."""
    whole: bool = False
    """Draw whole 640x480 frames although only strips of them are read (six times slower)."""
    out: Path | None = None
    """Folder for the results (default out/drive)."""
    json: bool = False
    """Print the summary as one JSON object and nothing else."""


@dataclass(frozen=True)
class Arenas:
    """List the arenas."""


Subcommand = Annotated[Drive, tyro.conf.subcommand("drive")] | Annotated[Arenas, tyro.conf.subcommand("arenas")]


def main(arguments: list[str] | None = None) -> int:
    """Entry point; returns the exit code: 0, 2 for unusable input, 130 for Ctrl-C."""
    command = tyro.cli(
        Subcommand,
        prog="python -m robot",
        description="The robot, in a simulated building.",
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff),
    )
    try:
        return run_drive(command) if isinstance(command, Drive) else list_arenas()
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped before there was anything to keep", file=sys.stderr)
        return INTERRUPTED


def list_arenas() -> int:
    """Print name, size and description of every arena."""
    from robot.sim.arenas import ARENAS

    for name, make in ARENAS.items():
        left, right, bottom, top = make(0).bounds
        print(f"{name:9s} {right - left:4.0f} x {top - bottom:<3.0f} m  {(make.__doc__ or '').splitlines()[0]}")
    print("\nOr a .toml file; its keys are described in robot/sim/arena_file.py.")
    return 0


def run_drive(command: Drive) -> int:
    """Drive, show the progress, write the results and the summary."""
    import torch

    from robot.config import load_config

    choices = asdict(command)
    del choices["config"], choices["json"]
    for flag in ("moving", "whole"):
        choices[flag] = choices[flag] or None  # a flag that is not given leaves the file's value
    config = load_config(command.config, choices)
    prepare(config.out)
    torch.set_num_threads(1)
    result = watched(config, quiet=command.json)
    write_results(result, config.out)
    if command.json:
        print(json.dumps(result.summary))
    else:
        print(describe(result))
    return INTERRUPTED if result.interrupted else 0


def watched(config: DriveConfig, quiet: bool) -> Result:
    """Drive with a progress bar on stderr, unless quiet."""
    from tqdm import tqdm

    from robot.drive import drive

    if quiet:
        return drive(config)
    bar = None

    def progress(made: int, total: int) -> None:
        nonlocal bar
        if bar is None:  # only now, so that an error before the first frame stands alone
            bar = tqdm(total=total, desc=f"{config.arena} seed {config.seed}", unit=" frames", file=sys.stderr)
        bar.update()
        if made == total:
            bar.close()

    try:
        return drive(config, progress)
    finally:
        if bar is not None:
            bar.close()


def prepare(folder: Path) -> None:
    """Make the folder for the results, before the time of a drive is spent."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {folder}: cannot make this folder ({error.strerror})") from None
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"--out {folder}: cannot write into this folder")


def write_results(result: Result, folder: Path) -> None:
    """All files of a drive."""
    import numpy as np

    from robot.figures import write_figures

    (folder / "summary.json").write_text(json.dumps(result.summary, indent=1) + "\n")
    g = result.grid
    np.savez_compressed(
        folder / "map.npz",
        cells=result.cells.numpy(),
        bounds=np.array([g.left, g.right, g.bottom, g.top]),
        cell=g.cell,
        true_path=result.record.array("pose"),
        believed_path=result.record.array("believed"),
    )
    write_figures(result, folder)


def describe(result: Result) -> str:
    """The summary in words."""
    s, c = result.summary, result.config
    score, times = s["map"], s["step_ms"]
    assert isinstance(score, dict)
    assert isinstance(times, dict)
    seconds, wall, passed = (float(str(s[key])) for key in ("simulated_seconds", "wall_seconds", "free_area_passed"))

    def value(key: str, unit: str, factor: float = 1.0) -> str:
        return "-" if score[key] is None else f"{factor * score[key]:.1f} {unit}"

    lines = [
        f"{c.arena}, seed {c.seed}, {c.controller}" + (" (interrupted)" if result.interrupted else ""),
        f"  {seconds:.0f} s and {s['distance_m']:.0f} m driven in {wall:.1f} s, "
        f"{seconds / max(wall, 1e-9):.1f}x real time",
        f"  collisions {s['collisions']} ({s['collisions_per_hour']} an hour), stops {s['stopped']}, "
        f"turns {s['turns']}, free area passed {100 * passed:.0f} %",
        f"  map: {value('precision', '%', 100)} of its mass near true edges, {value('recall', '%', 100)} of the "
        f"visible edges found, position error {value('position_error_cm', 'cm')}, "
        f"door spacing error {value('spacing_error_percent', '%')}",
        f"  navigation step: median {times.get('p50', 0):.2f} ms, 99 % below {times.get('p99', 0):.2f} ms",
        f"  written to {c.out}: summary.json path.png map.png map.npz speeds.png rows.png",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
