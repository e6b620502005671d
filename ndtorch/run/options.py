"""What `ndtorch bind` can be asked to do, and which model knows which option. Importing it imports no torch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ndtorch.errors import InputError
from ndtorch.scenes.named import SCENES

DEFAULT_SOURCE = "two-bars"
CAMERA_SECONDS = 30.0


@dataclass(frozen=True)
class BindJob:
    """What to run. None leaves the default."""

    source: str = DEFAULT_SOURCE
    """Scene, file, folder, camera or address."""
    model: str | None = None
    """Name of a model (published, scale-free, retinotopic, foreground) or a folder of your own. The default is
    scale-free for scenes and foreground for files, folders, cameras and streams; no other option changes it."""
    seconds: float | None = None
    """Seconds to take of a scene (default 19), with the time that filters settle, or of a video (all)."""
    phase: float | None = None
    """Scenes: lead of the green bar's brightness over the red bar's, degrees (default 290)."""
    gamma: float | None = None
    """Learning rate, 1/s (default 0.5 for published, 0.2 for scale-free)."""
    rule: str | None = None
    """Learning rule of published: competitive (default), cooperative or hebbian."""
    order: str | None = None
    """Published: high-pass before group normalisation (filter-first, default) or after it, as in print (printed)."""
    first_stage_radius: float | None = None
    """Spectral radius to train the first stage to (default: the model's own, 0.9)."""
    settle: float | None = None
    """Seconds before learning starts (default 4 for published, 0.5 for scale-free)."""
    seed: int | None = None
    """Scenes: pattern of the random shadow."""
    fps: float | None = None
    """Frames per second of a scene (default 100), or of a video that declares a wrong rate."""
    start: int | None = None
    """Videos: number of the first frame to use."""
    stop: int | None = None
    """Videos: number of the frame to stop before."""
    every: int | None = None
    """Videos: use every n-th frame, where the model is too slow for all."""
    fit: str | None = None
    """Videos: crop to the middle square (default) or stretch. The model foreground takes the whole picture."""
    device: str = "cpu"
    """Torch device."""
    pictures: float = 5.0
    """Pictures per second of the source; 0 for none."""
    resume: Path | None = None
    """Result folder of an earlier run to go on from, with the model it was made with."""


KNOWN_BY: dict[str, tuple[str, ...]] = {
    "rule": ("published",),
    "order": ("published",),
    "gamma": ("published", "scale-free"),
    "settle": ("published", "scale-free"),
    "first_stage_radius": ("published", "scale-free"),
    "fit": ("published", "scale-free", "retinotopic"),
}
"""The models that know an option; every model knows those that are not here."""

MODEL_OPTIONS = ("rule", "order", "gamma", "settle")
"""Options that go into the model's own constants."""

FIXED_BY_RESUME = ("phase", "order", "first_stage_radius", "settle", "seed", "fps", "start", "every", "fit")
"""Options that cannot change when a run is resumed."""

MOVED_RULE = "scale-free"


def flag(name: str) -> str:
    """An option as it is written on the command line."""
    return "--" + name.replace("_", "-")


def given(job: BindJob, names: tuple[str, ...]) -> dict[str, Any]:
    """Those of the options that were given."""
    return {name: value for name in names if (value := getattr(job, name)) not in (None, ())}


def default_model(source: str) -> str:
    """The model for a source when none is asked for: scale-free for scenes, foreground for everything else."""
    return "scale-free" if source in SCENES else "foreground"


def check_options(job: BindJob, kind: str) -> None:
    """Every given option is one that the model knows."""
    if job.rule == MOVED_RULE:
        raise InputError("--rule scale-free is a model of its own now: --model scale-free")
    for name in given(job, tuple(KNOWN_BY)):
        if kind not in KNOWN_BY[name]:
            raise InputError(f"{flag(name)} is an option of {', '.join(KNOWN_BY[name])}; the model is {kind}")


def check_numbers(job: BindJob) -> None:
    """Lengths and rates within reason, whatever the model."""
    if job.seconds is not None and not 0 < job.seconds < 1e7:
        raise InputError(f"seconds must be a positive number, got {job.seconds}")
    if not 0 <= job.pictures <= 1000:
        raise InputError(f"pictures must be between 0 and 1000 a second, got {job.pictures}")


def check_resume(job: BindJob, source: str, asked: str | None, model: str) -> None:
    """What was given besides --resume does not change the run."""
    for name in given(job, FIXED_BY_RESUME):
        raise InputError(f"{flag(name)} cannot change when a run is resumed; leave it out")
    if asked not in (None, model):
        raise InputError(f"{job.resume} is a run of the model {model}, and cannot go on with {asked}")
    if job.source not in (DEFAULT_SOURCE, source):
        raise InputError(f"{job.resume} is a run of {source}, not of {job.source}")
