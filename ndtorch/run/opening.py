"""From a job to an open source, a model and the state to go on from; everything that can be wrong is found here."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast

import torch
from pydantic import Field
from torch import Tensor

from ndtorch.binding import BindingModel, load_state, to_device, train_first_stage
from ndtorch.binding.saving import frames_taken, read_about
from ndtorch.errors import InputError, did_you_mean
from ndtorch.loading import load, model_kind, model_names
from ndtorch.run.options import (
    CAMERA_SECONDS,
    MODEL_OPTIONS,
    BindJob,
    check_numbers,
    check_options,
    check_resume,
    default_model,
    given,
)
from ndtorch.scenes import SCENES, FrameSource, make_scene
from ndtorch.scenes.named import SECONDS
from ndtorch.scenes.video import Fit, SourceFrames, VideoSource, open_video
from ndtorch.utils.toml import Strict, check

STATE = "state.safetensors"
CAMERA_MODELS = {"foreground": 448}
"""Kinds of models for video of a camera, which get whole pictures, and the most rows of those, shrunk as soon as they
are decoded: `foreground` needs two for one of its own."""


class KeptOptions(Strict):
    """Constants of the model that were given."""

    rule: str | None = None
    order: str | None = None
    gamma: float | None = None
    settle: float | None = Field(None, ge=0, le=1e7)


class KeptScene(Strict):
    """Options of a simulated scene that were given."""

    phase: float = 0.0
    seed: int = Field(0, ge=0, lt=2**31)
    fps: float = Field(100.0, ge=1e-3, le=1e5)


class KeptRun(Strict):
    """What a state says of the run that it ended: it may come from anywhere."""

    model: str
    source: str
    frames: int = Field(ge=0, le=10**9)
    fps: float = Field(ge=1e-3, le=1e6)
    options: KeptOptions
    scene: KeptScene
    fit: Literal["crop", "stretch"] | None = None
    first_stage_radius: float | None = None
    first: int = Field(0, ge=0, le=10**9)
    every: int | None = Field(None, ge=1, le=10**6)
    video_fps: float | None = Field(None, ge=1e-3, le=1e6)


@dataclass
class Prepared:
    """A job with its source open, its model built and its state loaded.

    Attributes:
        source, model: what to run.
        state: where an earlier run ended, or None.
        start: number of the first frame.
        chosen: the model in words, and why it is this one.
        about: all that is needed to go on later, for the file of the state.
    """

    source: FrameSource
    model: BindingModel
    state: Any
    start: int
    chosen: str
    about: dict[str, Any]


def prepare(job: BindJob) -> Prepared:
    """Open the source and build the model. Raises `InputError`: in one line, whatever is wrong."""
    check_numbers(job)
    device = check_device(job.device)
    about = {} if job.resume is None else described(job.resume)
    name = about.get("source", job.source)
    asked = None if job.model is None else identity(job.model)
    model_name = about.get("model", asked or default_model(name))
    if job.resume is not None and model_name not in (*model_names(), asked):
        check_near(job.resume, "model", model_name, f"--model {shlex.quote(model_name)}")
    kind = model_kind(model_name)
    if job.resume is not None:
        check_resume(job, name, asked, model_name)
        if name not in SCENES and job.source != name:
            check_near(job.resume, "source", name, f"ndtorch bind {shlex.quote(name)} --resume {job.resume}")
    check_options(job, kind)
    if kind in CAMERA_MODELS and device.type != "cpu":
        raise InputError(f"device must be cpu with the model {kind}, which is quickest there; got {job.device}")
    start = {
        "scene": given(job, ("phase", "seed", "fps")) if name in SCENES else {},
        "fps": job.fps,
        "video_fps": job.fps,
        "fit": job.fit,
        "first_stage_radius": job.first_stage_radius,
        "first": job.start or 0,
        "every": job.every or 1,
        "frames": 0,
    }
    options = {**about.get("options", {}), **given(job, MODEL_OPTIONS)}
    about = {**start, **about, "source": name, "model": model_name, "options": options}
    first = 0
    if name in SCENES:
        source, first = open_scene(job, about), about["frames"]
        model = make_model(about, source.size, source.fps, "wrap")
    else:
        source = open_place(job, about, CAMERA_MODELS.get(kind))
        first = 0 if is_live(name) else about["frames"]
        model = make_model(about, source.size, source.fps, "reflect")
    about["fps"] = source.fps
    state = None
    if job.resume is not None:
        state = to_device(load_state(job.resume / STATE, model)[0], device)
        check_count(job.resume / STATE, state, about["frames"])
    return Prepared(source, model.to(device), state, first, chosen(job, name, model_name, kind), about)


def check_count(path: Path, state: Any, frames: int) -> None:
    """Raise `InputError` where a state has not seen as many frames as its run is said to have had.

    The sum of the file says that it is whole, not that it tells the truth: a scene would go on at another place.
    """
    taken = frames_taken(state)
    if taken is not None and taken != frames:
        raise InputError(f"{path} says that it ended at frame {frames}, and its state has seen {taken}")


def make_model(about: dict[str, Any], size: tuple[int, int], fps: float, border: str) -> BindingModel:
    """The model of a run, for frames of that size and rate."""
    options = dict(about["options"])
    if about["first_stage_radius"] is not None:
        options["first_stage"] = train_first_stage(radius=about["first_stage_radius"])
    if model_kind(about["model"]) not in CAMERA_MODELS:
        options["border"] = border
    return load(about["model"], size=size, fps=fps, **options)


def identity(model: str) -> str:
    """A model as it is kept with a run: the name of one that comes with the package, or the whole path of a folder."""
    return str(Path(model).resolve()) if model not in model_names() and Path(model).is_dir() else model


def chosen(job: BindJob, source: str, model: str, kind: str) -> str:
    """The model as the first line of a run names it: "foreground (default for files and cameras)"."""
    if job.resume is not None:
        return f"{model} (that of the run that goes on)"
    if job.model is not None:
        return model if model == kind else f"{model} ({kind})"
    return f"{model} (default for {'scenes' if source in SCENES else 'files and cameras'})"


def open_scene(job: BindJob, about: dict[str, Any]) -> FrameSource:
    """A simulated scene as long as the job wants it, from its first frame on."""
    if job.start is not None or job.stop is not None:
        raise InputError("start and stop are frame numbers of videos; a scene has --seconds")
    if job.fit is not None:
        raise InputError("--fit is for the frames of videos; a scene has the size that is wanted")
    options = about["scene"]
    more = SECONDS if job.seconds is None else job.seconds
    return make_scene(about["source"], seconds=about["frames"] / options.get("fps", 100.0) + more, **options)


def open_place(job: BindJob, about: dict[str, Any], rows: int | None) -> FrameSource:
    """A file, folder, camera or stream; with `rows`, whole pictures of that height."""
    name = about["source"]
    for key in given(job, ("phase", "seed")):
        raise InputError(f"{key} is an option of simulated scenes, and {name} is none")
    if not is_known_place(name):
        raise InputError(
            f"source must be a file, a folder, a camera or one of {', '.join(SCENES)}; got {name!r}{source_meant(name)}"
        )
    if not is_live(name) and not Path(name).exists():
        raise InputError(f"video {name} does not exist{source_meant(name)}")
    # What a camera showed before is gone: it goes on where it is.
    live = is_live(name)
    first, begin = (None, 0) if live and about["frames"] else (about["first"] or None, about["frames"])
    size, fit = ((500, 500), cast("Fit", about["fit"] or "crop")) if rows is None else ((rows, rows), "reduce")
    every, fps = about["every"] or 1, about["video_fps"]
    if live and about["frames"]:
        fps = about["fps"] * every  # the model was made for the rate that was measured then
    video = open_video(name, size, fps, first, job.stop, fit, every)
    seconds = job.seconds if job.seconds is not None else (CAMERA_SECONDS if live and job.stop is None else None)
    return video if seconds is None else Limited(video, seconds, begin)


def source_meant(name: str) -> str:
    """A question for the source that was meant: a scene, or a file or folder beside the one that is not there."""
    place = Path(name)
    beside = [] if not place.parent.is_dir() else [str(place.with_name(other.name)) for other in place.parent.iterdir()]
    return did_you_mean(name, [*SCENES, *beside], 0.75)


def is_live(name: str) -> bool:
    """Whether a source is a camera or a stream, every frame of which passes once."""
    return name.isdigit() or name.startswith("camera:") or "://" in name or Path(name).is_char_device()


def is_known_place(name: str) -> bool:
    """Whether a source that is no scene looks like something that can be opened."""
    return Path(name).exists() or name.isdigit() or name.startswith("camera:") or "/" in name or "." in name


class Limited(FrameSource):
    """The first seconds of a video, from frame number `begin` on."""

    def __init__(self, source: VideoSource, seconds: float, begin: int = 0) -> None:
        self.source = source
        self.name, self.fps, self.size, self.pixel_map = source.name, source.fps, source.size, source.pixel_map
        frames = begin + max(1, round(seconds * source.fps))
        self.length = frames if source.length is None else min(frames, source.length)

    @property
    def full_size(self) -> tuple[int, int]:
        return self.source.full_size

    @property
    def decoded(self) -> SourceFrames:
        return self.source.decoded

    def latest(self) -> Any:
        return self.source.latest()

    def chunks(self, frames: int = 8, start: int = 0) -> Iterator[Tensor]:
        return self._first(self.source.chunks(frames, start), start)

    def _first(self, chunks: Iterator[Tensor], start: int) -> Iterator[Tensor]:
        assert self.length is not None
        left = self.length - start
        for chunk in chunks:
            yield chunk[:left]
            left -= len(chunk)
            if left <= 0:
                return
            self.cuts = self.source.cuts
        self.cuts, self.silent = self.source.cuts, self.source.silent


def check_device(name: str) -> torch.device:
    """The torch device of that name, or `InputError` when it is unknown or not there."""
    try:
        device = torch.device(name)
        if device.type == "cpu" and device.index:
            raise RuntimeError("there is one cpu")
        torch.zeros(1, device=device).item()  # a meta tensor has none
    except (RuntimeError, AssertionError) as error:
        raise InputError(f"device {name!r} cannot be used: {str(error).splitlines()[0]}") from None
    return device


def described(folder: Path) -> dict[str, Any]:
    """The description of an earlier run. Raises `InputError`: no state there, or one that another program wrote."""
    wrong = f"{folder}/{STATE} was not written by this version of ndtorch bind"
    try:
        about = json.loads(read_about(folder / STATE)["run"])
        return check(about, KeptRun, wrong).model_dump(exclude_unset=True)
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise InputError(str(error) if isinstance(error, InputError) else wrong) from None


def check_near(folder: Path, what: str, name: str, again: str) -> None:
    """Raise `InputError` unless something that a folder names is a file or folder beside that folder or below it.

    A folder may come from anybody: cameras, addresses and files elsewhere are opened if the user names them again.
    """
    path = Path(name).resolve()
    plain = "://" not in name and not name.isdigit() and (path.is_file() or path.is_dir())
    if not (plain and folder.resolve().parent in path.parents):
        raise InputError(f"{folder} is a run of the {what} {name}; name it again to open it: {again}")
