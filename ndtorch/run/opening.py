"""From a job to an open source, a model and the state to go on from; everything that can be wrong is found here."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import torch

from ndtorch.binding import BindingModel, load_state, to_device
from ndtorch.binding.saving import frames_taken, read_about
from ndtorch.errors import InputError, did_you_mean
from ndtorch.loading import load, model_kind, model_names
from ndtorch.run.arguments import check_ranges
from ndtorch.run.options import (
    CAMERA_SECONDS,
    DEFAULT_SOURCE,
    FIXED,
    OWN,
    BindJob,
    given,
    values_of,
)
from ndtorch.scenes import SCENES, FrameSource, make_scene
from ndtorch.scenes.named import SECONDS
from ndtorch.scenes.video import Fit, open_video
from ndtorch.utils.toml import check

STATE = "state.safetensors"
SCENE = "scene."
"""How keys of `--set` begin that are options of a scene."""
CAMERA_MODELS = {"foreground": 448}
"""Kinds of models for video of a camera, which get whole pictures, and the most rows of those, shrunk as soon as they
are decoded: `foreground` needs two for one of its own."""


@dataclass(frozen=True)
class KeptRun(BindJob):
    """What a state says of the run that it ended: its options, the frames that it had, and their rate."""

    frames: int = 0
    rate: float | None = None


@dataclass
class Prepared:
    """A job with its source open, its model built and its state loaded.

    Attributes:
        source, model: what to run.
        state: where an earlier run ended, or None.
        start: number of the first frame.
        most: frames to take; None for all.
        chosen: the model in words, and why it is this one.
        about: all that is needed to go on later, for the file of the state.
    """

    source: FrameSource
    model: BindingModel
    state: Any
    start: int
    most: int | None
    chosen: str
    about: dict[str, Any]


def prepare(job: BindJob) -> Prepared:
    """Open the source and build the model. Raises `InputError`: in one line, whatever is wrong."""
    if job.seconds == 0:
        raise InputError("seconds must be a positive number, got 0")
    try:
        device = torch.device(job.device)
        if device.type == "cpu" and device.index:
            raise RuntimeError("there is one cpu")
        torch.zeros(1, device=device).item()  # a meta tensor has none
    except (RuntimeError, AssertionError) as error:
        raise InputError(f"device {job.device!r} cannot be used: {str(error).splitlines()[0]}") from None
    if job.model is not None and job.model not in model_names() and Path(job.model).is_dir():
        job = dataclasses.replace(job, model=str(Path(job.model).resolve()))
    kept = KeptRun() if job.resume is None else resumed(job.resume, job)
    chosen = "default for " + ("scenes" if job.source in SCENES else "files and cameras") if job.model is None else ""
    if job.resume is not None:
        job = dataclasses.replace(kept, **given(job, *OWN), set=kept.set + job.set)
        chosen = "that of the run that goes on"
    model_name = job.model or ("scale-free" if job.source in SCENES else "foreground")
    kind = model_kind(model_name)
    if kind in CAMERA_MODELS and device.type != "cpu":
        raise InputError(f"device must be cpu with the model {kind}, which is quickest there; got {job.device}")
    if kind in CAMERA_MODELS and job.fit is not None:
        raise InputError(f"--fit is no option of {kind}, which takes the whole picture")
    options = {} if kind in CAMERA_MODELS else {"border": "wrap" if job.source in SCENES else "reflect"}
    options |= values_of(job.set)
    of_scene = {key.removeprefix(SCENE): options.pop(key) for key in list(options) if key.startswith(SCENE)}
    if of_scene and job.source not in SCENES:
        raise InputError(f"--set {SCENE}... is an option of simulated scenes, and {job.source} is none")
    if not_set := options.keys() & {"size", "fps", "model", "backend", "first_stage"}:
        raise InputError(f"--set has keys of config.toml but model, size and fps; got {not_set.pop()}")
    live, seconds = is_live(job.source), job.seconds
    if job.source in SCENES:
        if job.start is not None or job.stop is not None:
            raise InputError("start and stop are frame numbers of videos; a scene has --seconds")
        if job.fit is not None:
            raise InputError("--fit is for the frames of videos; a scene has the size that is wanted")
        length = kept.frames / (job.fps or 100.0) + (SECONDS if seconds is None else seconds)
        source = make_scene(job.source, **{"seconds": length, **given(job, "fps"), **of_scene})
        seconds = None
    else:
        source = open_place(job, kept, CAMERA_MODELS.get(kind))
        seconds = CAMERA_SECONDS if seconds is None and live and job.stop is None else seconds
    model = load(model_name, size=source.size, fps=source.fps, **options).to(device)
    state = None
    if kept.resume is not None:
        path = kept.resume / STATE
        state = to_device(load_state(path, model)[0], device)
        taken = frames_taken(state)
        # The sum of the file says that it is whole, not that it tells the truth.
        if taken is not None and taken != kept.frames:
            raise InputError(f"{path} says that it ended at frame {kept.frames}, and its state has seen {taken}")
    said = given(job, *FIXED, "set")
    about = {"source": job.source, "model": model_name, "frames": kept.frames, "rate": source.fps, **said}
    name = " ".join([model_name, *[f"({words})" for words in (kind, chosen) if words and words != model_name]])
    if model.group > 1:
        name += f", {model.group} of {source.fps:g} frames/s averaged"
    most = None if seconds is None else max(1, round(seconds * source.fps))
    return Prepared(source, model, state, 0 if live else kept.frames, most, name, about)


def resumed(folder: Path, job: BindJob) -> KeptRun:
    """The run that a folder is of; `InputError` where there is none, or where the job asks for something else."""
    wrong = f"{folder}/{STATE} was not written by this version of ndtorch bind"
    try:
        kept = check(json.loads(read_about(folder / STATE)["run"]), KeptRun, wrong)
        check_ranges(kept)
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise InputError(str(error) if isinstance(error, InputError) else wrong) from None
    for name in given(job, *FIXED):
        raise InputError(f"--{name} cannot change when a run is resumed; leave it out")
    if job.model not in (None, kept.model):
        raise InputError(f"{folder} is a run of the model {kept.model}, and cannot go on with {job.model}")
    if job.source not in (DEFAULT_SOURCE, kept.source):
        raise InputError(f"{folder} is a run of {kept.source}, not of {job.source}")
    return dataclasses.replace(kept, resume=folder)


def open_place(job: BindJob, kept: KeptRun, rows: int | None) -> FrameSource:
    """A file, folder, camera or stream; with `rows`, whole pictures of that height."""
    name = job.source
    live, path = is_live(name), Path(name)
    if not live and not path.exists():
        beside = [str(path.with_name(other.name)) for other in path.parent.iterdir()] if path.parent.is_dir() else []
        meant = did_you_mean(name, [*SCENES, *beside], 0.75)
        if "/" in name or "." in name:
            raise InputError(f"video {name} does not exist{meant}")
        known = ", ".join(SCENES)
        raise InputError(f"source must be a file, a folder, a camera or one of {known}; got {name!r}{meant}")
    # A camera goes on where it is, at the rate that was measured for the model.
    goes_on = live and kept.frames > 0
    first, every = (None if goes_on else job.start), job.every or 1
    fps = (kept.rate or 0) * every if goes_on else job.fps
    size, fit = ((500, 500), cast("Fit", job.fit or "crop")) if rows is None else ((rows, rows), "reduce")
    return open_video(name, size, fps, first, job.stop, fit, every)


def is_live(name: str) -> bool:
    """Whether a source is a camera or a stream, every frame of which passes once."""
    return name.isdigit() or name.startswith("camera:") or "://" in name or Path(name).is_char_device()
