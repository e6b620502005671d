"""`ndtorch drive`."""

from __future__ import annotations

import contextlib
import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from ndtorch.cli.command_run import INCOMPLETE, INTERRUPTED
from ndtorch_robot.navigator_options import navigator_options

if TYPE_CHECKING:
    from tqdm import tqdm

    from ndtorch_robot.config import DriveConfig
    from ndtorch_robot.drive import Result
    from ndtorch_robot.ports import Step

CAPTIONS = {
    "path": "The true path over the true plan, with turns, reversing, collisions and stops.",
    "map": "Red: the map, the darker the more certain.",
    "pose": "How far dead reckoning and the corrected pose are from the truth.",
    "rows": "One row of pixels of each camera, stacked over time. Dots are features with a range.",
    "speeds": "Above: how fast the image moves on both sides. Below: what the controller weighs, and where it acts.",
}


@dataclass(frozen=True)
@navigator_options()
class Drive:
    """Drive through a simulated building, steering and mapping by sight.

    Shows the progress and a summary, and writes report.html with all pictures, summary.json, path.png, map.png,
    map.npz, map.pgm and map.yaml (these two for ROS), speeds.png and rows.png; with --localise also pose.png. Options
    override the file. Ctrl-C stops the robot and writes all results.
    """

    config: Annotated[Path | None, tyro.conf.Positional] = None
    """TOML file whose keys are the options below."""
    robot: Path | None = None
    """Configuration of a robot, a file or one of robot/configs by name (default: the car of [A])."""
    arena: str | None = None
    """Arena, a name (see `ndtorch arenas`) or a .toml file (default: hallway)."""
    seed: int | None = None
    """Seed of building, textures and start (default: 0)."""
    seconds: float | None = None
    """Simulated time, s (default: 60)."""
    odometry: Literal["true", "noisy"] | None = None
    """Dead reckoning: exact (default), or 1 % too long with a drift of 0.05 degrees a second."""
    walls: Literal["textured", "blank"] | None = None
    """Walls: with panels, doors and papers (default), or without texture."""
    pedestrian: bool = False
    """Add a person who walks to and fro."""
    disturbance: str | None = None
    """Disturbances of cameras and car: names (noise, flicker, pitch-up, ...) or KEY=NUMBER, with commas."""
    full_frames: bool = False
    """Render full frames although only strips of them are read (six times slower)."""
    out: Path | None = None
    """Folder of the results (default: out/drive), or the next free one: out/drive-2."""
    force: bool = False
    """Write into that folder even if results are there."""
    rrd: Path | None = None
    """File for the rerun viewer, with full frames."""
    view: bool = False
    """Show the drive in the rerun viewer as it goes, with full frames."""
    view_at: str | None = None
    """ADDRESS or ADDRESS:PORT of a server, for `rerun rerun+http://ADDRESS:9876/proxy` elsewhere."""
    record: Path | None = None
    """New file of a recording, NAME.mcap, for `ndtorch replay`, Foxglove and ROS 2."""
    open: bool = False
    """Open report.html in the browser at the end."""
    json: bool = False
    """Print the summary as one JSON object, and nothing else."""

    def run(self) -> int:
        import torch

        from ndtorch.report.page import NAME, open_in_browser
        from ndtorch.report.recording import why_not_whole
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
            result = with_progress(config, quiet=self.json)
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
        if self.open:
            open_in_browser(folder.final / NAME)
        troubles = [(result.summary["recording"] or {}).get("failed"), config.rrd and why_not_whole(config.rrd)]
        for line in filter(None, troubles):
            print(f"error: {line}", file=sys.stderr)
        return INTERRUPTED if result.interrupted else INCOMPLETE if any(troubles) else 0


def with_progress(config: DriveConfig, quiet: bool) -> Result:
    """Drive with a progress bar."""
    from ndtorch.run.progress import progress_bar
    from ndtorch_robot.drive import drive

    with contextlib.ExitStack() as stack:
        bars: list[tqdm[Any]] = []

        def progress(step: Step) -> None:
            if not bars:  # only now, so that an error before the first frame stands alone
                total, words = round(config.seconds * config.rate), f"{config.arena} seed {config.seed}"
                bars.append(stack.enter_context(progress_bar(total, desc=words, unit=" frames")))
            bars[0].update()

        return drive(config, [] if quiet else [progress])


def write_results(result: Result, folder: Path) -> None:
    """Write all files of a drive."""
    from ndtorch.navigation.mapping.map_files import save_map
    from ndtorch.report.page import Page, Shown, command_line, versions
    from ndtorch_robot.evaluation.plots import write_plots

    (folder / "summary.json").write_text(json.dumps(result.summary, indent=1) + "\n")
    names = {"true_path": "pose", "believed_path": "believed", "located_path": "located"}
    paths = {key: result.record.array(name) for key, name in names.items()}
    save_map(folder, result.cells, result.grid, result.walked, result.ndt_cells, **paths)
    write_plots(result, folder)
    title, *answer = describe(result).splitlines()
    facts = result.config.model_dump(include={"arena", "seed", "controller", "walls", "odometry", "disturbance"})
    facts = {key: str(value) for key, value in facts.items()} | versions("ndtorch-robot")
    pictures = {name: folder / f"{name}.png" for name in CAPTIONS}
    shown = [Shown(file, name, CAPTIONS[name]) for name, file in pictures.items() if file.exists()]
    Page(f"A drive: {title}", [line.strip() for line in answer], command_line(), facts, (), shown).write(folder)


def describe(result: Result) -> str:
    """The summary in words."""
    s, c = result.summary, result.config
    percents = {
        "precision": "of its mass at true edges",
        "surfaces": "at any surface",
        "recall": "of the visible edges",
    }
    scores = [f"{100 * s['map'][key]:.0f} % {words}" for key, words in percents.items() if s["map"][key] is not None]
    seconds, wall, times = s["simulated_seconds"], s["wall_seconds"], s["step_ms"]
    lines = [
        ", ".join(filter(None, (f"{c.arena}, seed {c.seed}, {c.controller}", c.disturbance)))
        + " (interrupted)" * result.interrupted,
        f"  {seconds:.0f} s and {s['distance_m']:.0f} m driven, {seconds / max(wall, 1e-9):.1f}x real time",
        f"  collisions {s['collisions']} ({s['collisions_per_hour']} an hour), people hit {s['people_hit']}, "
        f"stops {s['stopped']}, turns {s['turns']}, free area passed within 1 m {100 * s['free_area_passed']:.0f} %",
        f"  map: {', '.join(scores) or 'nothing to compare'}",
    ]
    if s["faults"]:
        lines.append(f"  stood {len(s['faults'])} times because of its cameras; the first: {s['faults'][0]}")
    if s["troubles"]:
        lines.append(f"  stood because {'; '.join(s['troubles'])}")
    if result.ndt_cells is not None and s["pose_error"]:
        labels = {"believed": "dead reckoning", "located": "corrected"}
        errors = {label: s["pose_error"][name] for name, label in labels.items()}
        words = [f"{label} {e['end_m']:.2f} m and {e['end_degrees']:.1f} degrees" for label, e in errors.items()]
        lines.append(f"  error of the pose at the end: {', '.join(words)}")
    lines.append(f"  navigation step: median {times.get('p50', 0):.2f} ms, 99 % below {times.get('p99', 0):.2f} ms")
    return "\n".join(lines)
