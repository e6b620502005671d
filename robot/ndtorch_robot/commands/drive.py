"""`ndtorch drive`."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ndtorch.cli.command_run import INCOMPLETE, INTERRUPTED
from ndtorch_robot.config import DriveConfig

if TYPE_CHECKING:
    from ndtorch_robot.drive import DriveResult

CAPTIONS = {
    "path": "The true path over the true plan, with turns, reversing, collisions and stops.",
    "map": "Red: the map, the darker the more certain.",
}


@dataclass(frozen=True)
class DriveArena(DriveConfig):
    """Drive through a simulated building, steering and mapping by sight.

    Shows the progress and a summary, and writes report.html with all pictures, summary.json, path.png, map.png,
    map.npz, map.pgm and map.yaml (these two for ROS). Options override the file. Ctrl-C stops the robot and writes all
    results; SIGTERM all but the pictures.
    """

    config: Annotated[Path | None, tyro.conf.Positional] = None
    """TOML file whose keys are the options below."""
    force: bool = False
    """Write into that folder even if results are there."""
    json: bool = False
    """Print the summary as one JSON object, and nothing else."""

    def run(self) -> int:
        import torch

        from ndtorch.report.recording import why_not_whole
        from ndtorch.run.folder import RunFolder, new_file
        from ndtorch.run.progress import progress_bar
        from ndtorch_robot.drive import drive

        if self.rrd is not None:
            new_file(self.rrd, self.force)
        folder = RunFolder(self.out, self.force)
        torch.set_num_threads(1)
        total, words = round(self.seconds * self.robot_config.rate_hz), f"{self.arena} seed {self.seed}"
        try:
            with progress_bar(total, self.json, desc=words, unit=" frames", leave=False) as bar:
                result = drive(self.single(), [lambda step: bar.update()])
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
        troubles = [(result.summary["recording"] or {}).get("failed"), self.rrd and why_not_whole(self.rrd)]
        for line in filter(None, troubles):
            print(f"error: {line}", file=sys.stderr)
        return INTERRUPTED if result.interrupted else INCOMPLETE if any(troubles) else 0


def write_results(result: DriveResult, folder: Path) -> None:
    from ndtorch.report.page import Shown, write_page
    from ndtorch.report.plots import save
    from ndtorch.utils.signals import figures_wanted
    from ndtorch_robot.drive import FACTS
    from ndtorch_robot.evaluation.plots import map_plot, path_plot
    from ndtorch_robot.navigator_runner import save_runner_map

    (folder / "summary.json").write_text(json.dumps(result.summary, indent=1) + "\n")
    names = {"true_path": "pose", "believed_path": "believed", "located_path": "located"}
    save_runner_map(folder, result.runner, result.path, **{key: result.record.array(n) for key, n in names.items()})
    if figures_wanted():
        save(path_plot(result), folder / "path.png")
        save(map_plot(result), folder / "map.png")
    title, *answer = describe(result).splitlines()
    facts = {name: str(result.summary[name]) for name in FACTS}
    shown = [Shown(folder / f"{name}.png", name, words) for name, words in CAPTIONS.items()]
    told = [line.strip() for line in answer]
    write_page(folder, f"A drive: {title}", told, facts, shown=shown, used=["ndtorch-robot"])


def describe(result: DriveResult) -> str:
    s, times = result.summary, result.summary["step_ms"]
    kinds = {"precision": "of its mass at true edges", "surfaces": "at any surface", "recall": "of the visible edges"}
    scores = [f"{100 * s['map'][key]:.0f} % {words}" for key, words in kinds.items() if s["map"][key] is not None]
    speed = s["simulated_seconds"] / max(s["wall_seconds"], 1e-9)
    hits = f"{s['collisions']} ({s['collisions_per_hour']} an hour)"
    lines = [
        ", ".join(filter(None, (s["arena"], f"seed {s['seed']}", s["controller"], s["disturbance"])))
        + " (interrupted)" * result.interrupted,
        f"{s['simulated_seconds']:.0f} s and {s['distance_m']:.0f} m driven, {speed:.1f}x real time",
        f"collisions {hits}, stops {s['stopped']}, turns {s['turns']}, "
        f"free area passed within 1 m {100 * s['free_area_passed']:.0f} %",
        f"map: {', '.join(scores) or 'nothing to compare'}",
        *(f"stood: {why}" for why in (*s["faults"], *s["troubles"])),
    ]
    if result.runner.navigator.localiser is not None and s["pose_error"]:
        labels = {"dead reckoning": s["pose_error"]["believed"], "corrected": s["pose_error"]["located"]}
        words = [f"{name} {e['end_m']:.2f} m and {e['end_degrees']:.1f} degrees" for name, e in labels.items()]
        lines.append(f"error of the pose at the end: {', '.join(words)}")
    lines.append(f"navigation step: median {times.get('p50', 0):.2f} ms, 99 % below {times.get('p99', 0):.2f} ms")
    return "\n  ".join(lines)
