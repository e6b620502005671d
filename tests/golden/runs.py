"""The runs of the goldens as plain numbers: all that knows the names of the library stands in this file.

A drive is recorded as it goes by itself, and every command that is sent is kept, rounded. A test sends the kept
commands in place of those that the controller wants: so the car sees the same on every processor for the whole drive,
and what the controller wants in every frame can be compared. A drive that goes by itself amplifies rounding instead.
"""

from __future__ import annotations

import base64
import itertools
import tempfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

import ndtorch
from ndtorch.scenes import make_scene
from ndtorch_robot.commands.drive import write_results
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.drive import Result, drive
from ndtorch_robot.ports import DriveCommand, Step
from ndtorch_robot.recording import make_runner, open_recording, replay
from tests.golden.scenes import CLIPS, HEIGHT, WIDTH

Numbers = npt.NDArray[Any]
Kept = dict[str, Any]
Run = Callable[..., Kept]

FOREGROUND = "foreground"
MODELS, SCENES = ("published", "scale-free", "retinotopic", FOREGROUND), ("two-bars", "three-bars")
ARENAS, SEEDS = ("hallway", "loop", "room", "office", "chairs"), (0, 1)
SECONDS = {"published": 30.0, "ranging": 30.0, "goal": 15.0}
"""The controllers, and how long each drives."""
RATE, EVERY = 30, 15
"""Frames a second of a drive, and frames between two that are kept."""


def bind(model: str, scene: str) -> Kept:
    """The objects that a model finds in a scene or a clip, its weights at the end and some of its outputs."""
    if scene in CLIPS:
        clip = CLIPS[scene]
        binding, chunks = ndtorch.load(model, size=(HEIGHT, WIDTH), fps=clip.fps), clip.chunks(12)
    else:
        source = make_scene(scene, seconds=10.0)
        chunks = source.chunks(10)
        binding = ndtorch.load(model, size=source.size, fps=source.fps)
    state, outputs = None, list[torch.Tensor]()
    with torch.inference_mode():
        for frames in chunks:
            signals, state = binding(frames, state)
            outputs += [signals.outputs.reshape(len(signals.outputs), -1, 10).amax(1)]
        weights = binding.weights(state)
    learned = weights if weights.ndim == 2 else weights.amax(0)
    return {
        "verdict": binding.verdict(state),
        "objects": [bound_object(thing) for thing in binding.objects(state)],
        "weights": rounded(learned, 3),
        "outputs": rounded(torch.cat(outputs)[9::100], 3),
    }


def bound_object(thing: Any) -> Kept:
    """One object, with every tenth of its boxes."""
    return {
        "neuron": thing.neuron,
        "track": thing.track,
        "direction": thing.direction,
        "color": thing.color,
        "features": {name: round(value, 3) for name, value in thing.features.items()},
        "seen": [None if time is None else round(time, 3) for time in (thing.first_seen, thing.last_seen)],
        "places": rounded(thing.path[::10], 2),
        "boxes": rounded(thing.boxes[::10], 2),
    }


class Watch:
    """What is kept of a drive: what is wanted in every frame, and now and then what is seen.

    Args:
        commands: sent in place of what is wanted, `[T, 2]`; by default what is wanted, rounded.
    """

    def __init__(self, commands: Numbers | None = None) -> None:
        self.commands, self.wanted = commands, list[DriveCommand]()
        self.submaps = self.closures = 0

    def steer(self, wanted: DriveCommand) -> DriveCommand:
        """Note what is wanted and give what to send."""
        self.wanted.append(wanted)
        if self.commands is None:
            return DriveCommand(round(wanted.speed, 3), round(wanted.curvature, 3))
        return DriveCommand(*map(float, self.commands[len(self.wanted) - 1]))

    def __call__(self, step: Step) -> None:
        """Count the submaps of the localiser and the loop closures between them."""
        located = None if step.state is None else step.state.located
        if located is not None and located.graph is not None:
            self.submaps, self.closures = len(located.graph.submaps), len(located.graph.loop_closures)


def driven(golden: Kept | None, folder: Path | None = None, **options: Any) -> Kept:
    """What is kept of a drive.

    Args:
        golden: what was kept of it before, with the commands to send; None to send what is wanted.
        folder: where to write its files, if anywhere.
    """
    torch.set_num_threads(1)
    watch = Watch(None if golden is None else unpack(golden["wanted"]))
    result = drive(DriveConfig(**{"stereo": "features"} | options), observers=[watch], steer=watch.steer)
    record, summary = result.record, result.summary
    wanted = np.array([(command.speed, command.curvature) for command in watch.wanted])
    if folder is not None:
        write_results(result, folder)
    kept: Kept = {
        "wanted": pack(wanted),
        "modes": [[mode, len(list(run))] for mode, run in itertools.groupby(record.mode)],
        "poses": rounded(record.array("pose")[::EVERY], 3),
        "sides": rounded(np.nan_to_num(record.array("sides")[::EVERY]), 3),
        "ranges": [range_numbers(record.ranges[n : n + EVERY]) for n in range(0, len(record.ranges), EVERY)],
        "end": rounded(record.array("pose")[-1], 3),
        "collisions": [round(hit.time, 2) for hit in result.simulation.collisions],
        "stops": [round(time, 2) for time in result.stops],
        "distance": summary["distance_m"],
        "free_area": summary["free_area_passed"],
        "map": coarse_map(result),
        "map_scores": summary["map"],
    }
    if options.keys() & {"localise", "known_map"}:
        kept |= {
            "pose_errors": rounded(pose_errors(result)[:: RATE * 2], 3),
            "found": summary["found_s"],
            "submaps": watch.submaps,
            "closures": watch.closures,
        }
    return kept


def range_numbers(frames: Sequence[Numbers]) -> list[float]:
    """How many ranges of some frames are valid, and their median, m."""
    distance, _, _, valid = np.concatenate(frames, 1)
    valid = valid > 0
    return [int(valid.sum()), round(float(np.median(distance[valid])), 2) if valid.any() else 0.0]


def pose_errors(result: Result) -> Numbers:
    """How far the localiser's pose is from the true one, m and degrees, `[T, 2]`."""
    located, true = result.record.array("located"), result.record.array("pose")
    x, y, heading = (located - true).T
    return np.stack((np.hypot(x, y), np.degrees(np.angle(np.exp(1j * heading)))), -1)


def coarse_map(result: Result) -> list[list[float]]:
    """The map's cells summed over squares of 1 m, as shares of the whole in percent."""
    cells, side = result.cells.double().numpy(), round(1 / result.grid.cell)
    cells = np.pad(cells, [(0, -length % side) for length in cells.shape])
    high, wide = (length // side for length in cells.shape)
    sums = cells.reshape(high, side, wide, side).sum((1, 3))
    return rounded(100 * sums / max(sums.sum(), 1e-9), 2)


def goal_drive(golden: Kept | None) -> Kept:
    """To a place in a room of the office, and then wherever it was not yet."""
    return driven(golden, arena="office", controller="goal", goal="6.5,3", explore=True, seconds=40.0)


def localised(golden: Kept | None, seconds: float = 600.0) -> Kept:
    """Ten minutes through the office with a localiser that has to find out what is wrong with the odometer."""
    options: Kept = {"arena": "office", "controller": "ranging", "localise": True, "odometry": "noisy"}
    return driven(golden, seconds=seconds, **options)


def known_map(golden: Kept | None) -> Kept:
    """A loop is mapped; then the car is started in it anew and finds itself in that map."""
    options: Kept = {"arena": "loop", "controller": "ranging", "seed": 1}
    before = golden or {"mapped": None, "found": None}
    with tempfile.TemporaryDirectory() as folder:
        mapped = driven(before["mapped"], Path(folder), localise=True, seconds=45.0, **options)
        found = driven(before["found"], known_map=f"{folder}/map.npz", seconds=20.0, **options)
    return {"mapped": mapped, "found": found}


def replayed() -> Kept:
    """A drive of 3 s is recorded and driven again from its frames."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recording.mcap"
        driven(None, arena="loop", controller="ranging", seconds=3.0, record=path)
        recording = open_recording(path)
        comparison = replay(recording, make_runner(recording.configuration))
    return {"steps": comparison.steps, "same": comparison.same}


def all_runs() -> Iterator[tuple[str, Run]]:
    """The name of every run, and the function that makes it."""
    for model, scene in itertools.product(MODELS, SCENES):
        yield f"bind/{model}/{scene}", lambda _, model=model, scene=scene: bind(model, scene)
    for clip in CLIPS:
        yield f"bind/{FOREGROUND}/{clip}", lambda _, clip=clip: bind(FOREGROUND, clip)
    for controller, arena, seed in itertools.product(SECONDS, ARENAS, SEEDS):
        options: Kept = {"controller": controller, "arena": arena, "seed": seed, "seconds": SECONDS[controller]}
        yield f"drive/{controller}/{arena}/{seed}", partial(driven, **options)
    yield "drive/goal/explore", goal_drive
    yield "localise/office", localised
    yield "localise/known_map", known_map


RUNS = dict(all_runs())
"""Each takes what was kept of it before, or None to go by itself, and gives what is to be kept."""


def pack(numbers: Numbers) -> str:
    """Numbers `[T, 2]` to three decimals as text."""
    whole = np.round(np.asarray(numbers) * 1000).astype("<i2")
    steps = np.diff(whole, axis=0, prepend=np.zeros((1, whole.shape[1]), "<i2"))
    return base64.b85encode(zlib.compress(steps.T.astype("<i2").tobytes(), 9)).decode()


def unpack(text: str) -> Numbers:
    """The inverse of `pack`."""
    steps = np.frombuffer(zlib.decompress(base64.b85decode(text)), "<i2").reshape(2, -1).T
    return np.cumsum(steps, 0, dtype="<i2") / 1000


def rounded(numbers: Any, digits: int) -> Any:
    """An array, a tensor or nested lists as nested lists with so many decimals."""
    return np.round(np.asarray(numbers, np.float64), digits).tolist()
