"""What `ndtorch bind` can be asked to do. Importing it imports no torch."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import tyro

from ndtorch.errors import InputError

DEFAULT_SOURCE = "two-bars"
CAMERA_SECONDS = 30.0


@dataclass(frozen=True)
class BindOptions:
    """How to run. None leaves the default."""

    model: str | None = None
    """Model: published, scale-free, retinotopic, foreground, or a folder (default: scale-free for scenes, foreground
    for files, folders, cameras and streams)."""
    seconds: float | None = None
    """Length to take of a scene (default 19) or of a video (default all), s."""
    set: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Value of a key of the model's config.toml, as gamma=0.3 or network.gamma=0.3, or of a scene, as scene.phase=60;
    any number of times."""
    fps: float | None = None
    """Frame rate of a scene (default 100) or of a video that declares a wrong one, Hz."""
    start: int | None = None
    """Videos: number of the first frame to use."""
    stop: int | None = None
    """Videos: number of the frame to stop before."""
    every: int | None = None
    """Videos: step between the frames that are used, where the model is too slow for all."""
    fit: Literal["crop", "stretch"] | None = None
    """Videos: crop to the middle square (default) or stretch; foreground takes the whole picture."""
    device: str = "cpu"
    """Torch device."""
    pictures: float | None = None
    """Pictures of the source, 1/s; 0 for none (default: those of a video, for overlay.mp4; 5 for enhanced.mp4)."""
    resume: Path | None = None
    """Result folder of an earlier run to go on from, with its model and source."""


@dataclass(frozen=True)
class BindJob(BindOptions):
    """What to run, and how."""

    source: str = DEFAULT_SOURCE
    """Scene, file, folder, camera or address."""


FIXED = ("fps", "start", "every", "fit")
"""Options that cannot change when a run is resumed."""

OWN = ("seconds", "stop", "device", "pictures", "resume")
"""Options that a resumed run takes from its own command line."""


def given(job: BindOptions, *names: str) -> dict[str, Any]:
    """Those of the options that were given."""
    return {name: value for name in names if (value := getattr(job, name)) not in (None, ())}


def values_of(settings: Iterable[str]) -> dict[str, Any]:
    """Values by key, of `network.gamma=0.3`: as in TOML, or else a string."""
    values = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not (key and equals):
            raise InputError(f"--set takes KEY=VALUE, as network.gamma=0.3; got {setting!r}")
        try:
            values[key.strip()] = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            values[key.strip()] = text
    return values
