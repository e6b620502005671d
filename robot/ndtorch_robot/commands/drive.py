"""`ndtorch drive`."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from ndtorch.cli.command_run import INCOMPLETE, INTERRUPTED
from ndtorch_robot.navigator_options import navigator_options

if TYPE_CHECKING:
    from ndtorch_robot.config import DriveConfig
    from ndtorch_robot.drive import Result
    from ndtorch_robot.ports import Step


@dataclass(frozen=True)
@navigator_options()
class Drive:
    """Drive through a simulated building, steering and mapping by sight.

    Shows the progress and a summary, and writes report.html with all pictures, summary.json, path.png, map.png,
    map.npz, map.pgm and map.yaml (these two for ROS), speeds.png and rows.png; with --localise also
    pose.png. Options override the file. Ctrl-C stops the robot and writes all results.
    """

    config: Annotated[Path | None, tyro.conf.Positional] = None
    """The options below may be keys of this TOML file."""
    robot: Path | None = None
    """The robot of this file drives, or one of robot/configs by name (default: the car of [A])."""
    arena: str | None = None
    """The car drives in this arena, a name (see `ndtorch arenas`) or a .toml file (default: hallway)."""
    seed: int | None = None
    """Building, textures and start follow from this number (default: 0)."""
    seconds: float | None = None
    """The drive takes this simulated time, in s (default: 60)."""
    odometry: Literal["true", "noisy"] | None = None
    """Dead reckoning is exact (default), or 1 % too long and drifts by 0.05 degrees a second."""
    walls: Literal["textured", "blank"] | None = None
    """Walls have panels, doors and papers (default), or no texture at all."""
    pedestrian: bool = False
    """A box of the size of a person walks to and fro."""
    disturbance: str | None = None
    """These disturbances act on cameras and car: names (noise, flicker, pitch-up, ...) or KEY=NUMBER, with commas."""
    full_frames: bool = False
    """Full 640x480 frames are rendered although only strips of them are read (six times slower)."""
    out: Path | None = None
    """Results are written into this folder (default: out/drive), or into the next free one: out/drive-2."""
    force: bool = False
    """That folder is taken even if results are there; files of the same names are replaced."""
    rrd: Path | None = None
    """The drive is also written into this file for the rerun viewer, with full frames."""
    view: bool = False
    """The rerun viewer shows the drive as it goes, with full frames."""
    view_at: str | None = None
    """The drive is served at this ADDRESS or ADDRESS:PORT, for `rerun rerun+http://ADDRESS:9876/proxy` elsewhere."""
    record: Path | None = None
    """The drive is recorded into this new file, NAME.mcap, for `ndtorch replay`, Foxglove and ROS 2."""
    open: bool = False
    """The browser shows report.html when the drive has ended."""
    json: bool = False
    """The summary is printed as one JSON object, and nothing else is."""

    def run(self) -> int:
        import torch

        from ndtorch.report.page import NAME, open_in_browser
        from ndtorch.run.folder import RunFolder, new_file
        from ndtorch_robot.config import load_config

        choices = asdict(self)
        del choices["config"], choices["json"], choices["force"], choices["open"]
        # A flag that is not given leaves the file's value.
        config = load_config(self.config, {k: None if value is False else value for k, value in choices.items()})
        if config.rrd is not None:
            new_file(config.rrd, self.force)
        folder = RunFolder(config.out, self.force)
        torch.set_num_threads(1)
        try:
            result = watched(config, quiet=self.json)
            write_results(result, folder.work)
        except BaseException:
            folder.discard()
            raise
        files = folder.publish()
        if self.json:
            print(json.dumps(result.summary))
        else:
            print(describe(result))
            print(f"  written to {folder.final}: {' '.join(file.name for file in files)}")
            if config.rrd:
                print(f"  recording: rerun {config.rrd}")
        if self.open:
            open_in_browser(folder.final / NAME)
        half = unfinished(config, result)
        for line in half:
            print(f"error: {line}", file=sys.stderr)
        return INTERRUPTED if result.interrupted else INCOMPLETE if half else 0


def unfinished(config: DriveConfig, result: Result) -> list[str]:
    """What of the recordings is not whole, one line each."""
    from ndtorch.report.recording import why_not_whole

    failed = (result.summary["recording"] or {}).get("failed", "")
    half = why_not_whole(config.rrd) if config.rrd is not None else None
    return [line for line in (failed, half) if line]


def watched(config: DriveConfig, quiet: bool) -> Result:
    from ndtorch.run.progress import progress_bar
    from ndtorch_robot.drive import drive

    if quiet:
        return drive(config)
    bar = None

    def progress(step: Step) -> None:
        nonlocal bar
        if bar is None:  # only now, so that an error before the first frame stands alone
            total = round(config.seconds * config.rate)
            bar = progress_bar(total, desc=f"{config.arena} seed {config.seed}", unit=" frames")
        bar.update()

    try:
        return drive(config, [progress])
    finally:
        if bar is not None:
            bar.close()


def write_results(result: Result, folder: Path) -> None:
    from ndtorch.navigation.mapping.map_files import save_map
    from ndtorch_robot.evaluation.plots import write_plots
    from ndtorch_robot.evaluation.report import write_drive_page

    (folder / "summary.json").write_text(json.dumps(result.summary, indent=1) + "\n")
    true, believed, located = (result.record.array(name).reshape(-1, 3) for name in ("pose", "believed", "located"))
    paths = {"true_path": true, "believed_path": believed, "located_path": located}
    walked = located if result.walked is None else result.walked
    save_map(folder, result.cells, result.grid, walked, result.ndt_cells, **paths)
    write_plots(result, folder)
    write_drive_page(result, describe(result), folder)


def describe(result: Result) -> str:
    s, c = result.summary, result.config
    score, times = s["map"], s["step_ms"]
    keys = ("simulated_seconds", "wall_seconds", "free_area_passed", "free_area_passed_40cm")
    seconds, wall, passed, close = (s[key] for key in keys)

    def value(key: str, unit: str, factor: float = 1.0) -> str:
        return "-" if score[key] is None else f"{factor * score[key]:.1f} {unit}"

    located = []
    if result.ndt_cells is not None:
        errors = s["pose_error"]
        words = [
            f"{label} {errors[name]['end_m']:.2f} m and {errors[name]['end_degrees']:.1f} degrees"
            for name, label in (("believed", "dead reckoning"), ("located", "corrected"))
            if name in errors
        ]
        located = [f"  error of the pose at the end: {', '.join(words)}"]
    lines = [
        f"{c.arena}, seed {c.seed}, {c.controller}"
        + f", {c.disturbance}" * bool(c.disturbance)
        + (" (interrupted)" if result.interrupted else ""),
        f"  {seconds:.0f} s and {s['distance_m']:.0f} m driven in {wall:.1f} s, "
        f"{seconds / max(wall, 1e-9):.1f}x real time",
        f"  collisions {s['collisions']} ({s['collisions_per_hour']} an hour), stops {s['stopped']}, "
        f"turns {s['turns']}, free area passed within 1 m {100 * passed:.0f} %, within 0.4 m {100 * close:.0f} %",
        f"  map: {value('precision', '%', 100)} of its mass within 10 cm of true edges, {value('surfaces', '%', 100)} "
        f"of any surface, {value('recall', '%', 100)} of the visible edges found, "
        f"position error {value('position_error_cm', 'cm')}, door spacing error {value('spacing_error_percent', '%')}",
        *located,
        f"  navigation step: median {times.get('p50', 0):.2f} ms, 99 % below {times.get('p99', 0):.2f} ms",
    ]
    faults, troubles = s["faults"], s["troubles"]
    hit = f"people hit {s['people_hit']}, hit while standing {s['hit_while_standing']}"
    lines[3:3] = [
        *([f"  stood {len(faults)} times because of its cameras; the first: {faults[0]}"] if faults else []),
        *([f"  stood because {'; '.join(troubles)}"] if troubles else []),
        *([f"  places hit {s['collision_places']}, {hit}"] if s["collisions"] else []),
    ]
    return "\n".join(lines)
