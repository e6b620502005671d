"""What `ndtorch bind` is asked to do, and everything that can be wrong with it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor

from ndtorch.binding import (
    BindingState,
    VisualBinding,
    block_diagonal,
    load_state,
    to_device,
    train_first_stage,
)
from ndtorch.binding.models.published import SCALE_FREE
from ndtorch.errors import InputError
from ndtorch.loading import load
from ndtorch.run.video import ROWS, front_end
from ndtorch.scenes import SCENES, FrameSource, make_scene
from ndtorch.scenes.video import open_video

SCENE_SECONDS = 15.0
CAMERA_SECONDS = 30.0
MODEL_RADIUS = 0.9


@dataclass(frozen=True)
class BindJob:
    """What to run. None leaves the default."""

    source: str = "two-bars"
    """Scene, file, folder, camera or address."""
    seconds: float | None = None
    """Seconds to learn from a scene (default 15, the settling time comes on top), or to take of a video (all)."""
    phase: float | None = None
    """Scenes: lead of the green bar's brightness over the red bar's, degrees (default 290)."""
    gamma: float | None = None
    """Learning rate of the second stage, 1/s (default 0.5; 0.2 with the scale-free rule)."""
    rule: str | None = None
    """Learning rule: competitive (default), cooperative, hebbian, or scale-free, which has a read-out of its own."""
    order: str | None = None
    """High-pass before group normalisation (filter-first, default) or after it, as printed in the paper (printed)."""
    first_stage_radius: float | None = None
    """Spectral radius to train the first stage to (default: the shipped model, 0.9)."""
    settle: float | None = None
    """Seconds before learning starts (default 4; 0.5 with the scale-free rule)."""
    seed: int | None = None
    """Scenes: pattern of the random shadow."""
    fps: float | None = None
    """Frames per second of a scene (default 100), or of a video that declares a wrong rate."""
    start: int | None = None
    """Videos: number of the first frame to use."""
    stop: int | None = None
    """Videos: number of the frame to stop before."""
    fit: str = "crop"
    """Videos: crop to the middle square, or stretch."""
    device: str = "cpu"
    """Torch device."""
    pictures: float = 5.0
    """Enhanced pictures per second of the source; 0 for none."""
    resume: Path | None = None
    """Result folder of an earlier run to go on from."""
    front_end: Literal["auto", "on", "off"] = "auto"
    """Videos: the front end for ordinary video, with objects over time, or the published model (off). auto: on, unless
    an option of the published model (rule, order, gamma, settle, first-stage-radius, resume, fit stretch) is given."""
    without: tuple[str, ...] = ()
    """Front end: parts to switch off, among exposure, background, noise-floor, color-inhibition, scale, compression,
    fields and network."""


@dataclass
class Prepared:
    """A job with its source open, its model built and its state loaded."""

    source: FrameSource
    model: VisualBinding
    state: BindingState | None
    start: int
    about: dict[str, Any]


PUBLISHED_ONLY = ("rule", "order", "gamma", "settle", "first_stage_radius", "resume", "rrd")
"""Options that mean something to the published model only."""


def uses_front_end(job: BindJob) -> bool:
    """Whether a job is one for the front end for ordinary video.

    Raises:
        InputError: it was asked for where it cannot be, or parts of it are switched off where it is not used.
    """
    published = [name for name in PUBLISHED_ONLY if getattr(job, name, None) is not None]
    if job.fit != "crop":
        published.append("fit")
    video = job.source not in SCENES and job.resume is None
    if job.front_end == "on":
        if not video:
            raise InputError("front-end is for video; simulated scenes go without it")
        if published:
            raise InputError(f"--{published[0].replace('_', '-')} belongs to the published model; use --front-end off")
    on = job.front_end == "on" or (job.front_end == "auto" and video and not published)
    if job.without and not on:
        raise InputError("without switches off parts of the front end for video, which is not used here")
    return on


def prepare_video(job: BindJob) -> FrameSource:
    """Open the video of a job for the front end.

    Raises:
        InputError: in one line, whatever is wrong.
    """
    check_job(job)
    front_end(job.without)
    if torch.device(job.device).type != "cpu":
        raise InputError(f"device must be cpu with the front end, which is quickest there; got {job.device}")
    return open_source(job.source, job, 0.0, {}, ROWS)[0]


def check_job(job: BindJob) -> None:
    """What every kind of job has to fulfil."""
    check_device(job.device)
    if job.seconds is not None and not 0 < job.seconds < 1e7:
        raise InputError(f"seconds must be a positive number, got {job.seconds}")
    if not 0 <= job.pictures <= 1000:
        raise InputError(f"pictures must be between 0 and 1000 a second, got {job.pictures}")


def prepare(job: BindJob) -> Prepared:
    """Open the source and build the model; everything that can be wrong with a job is found here.

    Raises:
        InputError: in one line, whatever is wrong.
    """
    check_job(job)
    device = check_device(job.device)
    state, about = (None, {}) if job.resume is None else load_run(job.resume)
    given = {name: getattr(job, name) for name in ("gamma", "rule", "order", "settle")}
    options = {**about.get("config", {}), **{name: value for name, value in given.items() if value is not None}}
    if job.resume is not None:
        for name in ("phase", "order", "first_stage_radius", "settle", "seed", "fps", "start"):
            if getattr(job, name) is not None:
                raise InputError(f"--{name.replace('_', '-')} cannot change when a run is resumed; leave it out")
        if job.rule is not None and (job.rule == SCALE_FREE) != (about["config"].get("rule") == SCALE_FREE):
            raise InputError("--rule cannot change to or from scale-free when a run is resumed; leave it out")
        if job.source not in ("two-bars", about["source"]):
            raise InputError(f"{job.resume} is a run of {about['source']}, not of {job.source}")
    name = about.get("source", job.source)
    settle = options.get("settle", 4.0)
    source, scene_options, start = open_source(name, job, settle, about)
    is_video = name not in SCENES
    if options.get("rule") == SCALE_FREE:
        renamed = {"gamma": "scale_free_gamma", "settle": "scale_free_settle"}
        options |= {renamed[key]: options.pop(key) for key in renamed if given[key] is not None}
    model = load("binding", size=source.size, fps=source.fps, border="reflect" if is_video else "wrap", **options)
    radius = about.get("first_stage_radius", job.first_stage_radius)
    if radius is not None and radius != MODEL_RADIUS and state is None:
        first_stage = block_diagonal(train_first_stage(radius=radius))
        model = VisualBinding(first_stage, model.config, source.size, source.fps, "reflect" if is_video else "wrap")
    if state is not None:
        state = to_device(state, device)
    about = {
        "source": name,
        "scene": scene_options,
        "config": model.config.model_dump(),
        "first_stage_radius": radius,
        "fps": source.fps,
        "first": about.get("first", job.start or 0),
        "frames": about.get("frames", 0),
    }
    return Prepared(source, model.to(device), state, start, about)


def open_source(
    name: str, job: BindJob, settle: float, about: dict[str, Any], rows: int | None = None
) -> tuple[FrameSource, dict[str, Any], int]:
    """The source, the scene options worth saving, and the number of its first frame to use.

    With `rows`, a video comes whole, that many pixels high.
    """
    done = int(about.get("frames", 0))
    if name in SCENES:
        if job.start is not None or job.stop is not None:
            raise InputError("start and stop are frame numbers of videos; a scene has --seconds")
        if "scene" in about:
            options = dict(about["scene"])
        else:
            given = {"phase": job.phase, "seed": job.seed, "fps": job.fps}
            options = {key: value for key, value in given.items() if value is not None}
        fps = options.get("fps", 100.0)
        more = job.seconds if job.seconds is not None else SCENE_SECONDS
        # Learning seconds: the time for filters to settle comes on top, once.
        seconds = done / fps + more if done else settle + more
        return make_scene(name, seconds=seconds, **options), options, done
    for key in ("phase", "seed"):
        if getattr(job, key) is not None:
            raise InputError(f"{key} is an option of simulated scenes, and {name} is none")
    if not is_known_place(name):
        raise InputError(f"source must be a file, a folder, a camera or one of {', '.join(SCENES)}; got {name!r}")
    first = int(about.get("first", job.start or 0)) + done
    fps = about.get("fps", job.fps)
    if rows is None:
        video = open_video(name, fps=fps, start=first or None, stop=job.stop, fit=job.fit)  # type: ignore[arg-type]
    else:
        video = open_video(name, (rows, rows), fps, first or None, job.stop, "reduce")
    seconds = job.seconds if job.seconds is not None else (None if video.length is not None else CAMERA_SECONDS)
    return Limited(video, seconds) if seconds is not None else video, {}, 0


def is_known_place(name: str) -> bool:
    """Whether a source that is no scene looks like something that can be opened."""
    return Path(name).exists() or name.isdigit() or name.startswith("camera:") or "/" in name or "." in name


class Limited(FrameSource):
    """The first seconds of another source."""

    def __init__(self, source: FrameSource, seconds: float) -> None:
        self.source = source
        self.name, self.fps, self.size = source.name, source.fps, source.size
        frames = max(1, round(seconds * source.fps))
        self.length = frames if source.length is None else min(frames, source.length)

    def chunks(self, frames: int = 8, start: int = 0) -> Iterator[Tensor]:
        left = self.length
        assert left is not None
        for chunk in self.source.chunks(frames, start):
            yield chunk[:left]
            left -= len(chunk)
            if left <= 0:
                return


def check_device(name: str) -> torch.device:
    """The torch device of that name, or `InputError` when it is unknown or not there."""
    try:
        device = torch.device(name)
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError) as error:
        raise InputError(f"device {name!r} cannot be used: {str(error).splitlines()[0]}") from None
    return device


def load_run(folder: Path) -> tuple[BindingState, dict[str, Any]]:
    """State and description of an earlier run."""
    state, about = load_state(folder / "state.safetensors")
    try:
        described: dict[str, Any] = json.loads(about["run"])
    except (KeyError, json.JSONDecodeError):
        raise InputError(f"{folder}/state.safetensors was not written by ndtorch bind") from None
    return state, described
