"""Scenes by name, for command lines and tables of runs."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from ndtorch.errors import InputError
from ndtorch.scenes.bar_scenes import SECONDS, equal_bars, one_bar, three_bars, two_bars
from ndtorch.scenes.base import FrameSource
from ndtorch.scenes.rings import rings


class NamedScene(NamedTuple):
    """A way to build a scene, what it shows in one line, and the options it fixes."""

    build: Callable[..., FrameSource]
    description: str
    fixed: Mapping[str, Any]


SCENES: dict[str, NamedScene] = {
    "one-bar": NamedScene(one_bar, "a red bar moving through sine shadow", {}),
    "two-bars": NamedScene(two_bars, "the reference stimulus: red and green bars in sine shadow", {}),
    "three-bars": NamedScene(three_bars, "the reference stimulus and a blue bar moving left", {}),
    "two-bars-distance": NamedScene(
        two_bars, "red and green bars that come nearer and go away, no shadow", {"fluctuation": "distance"}
    ),
    "two-bars-random": NamedScene(two_bars, "red and green bars in a random dappled shadow", {"fluctuation": "random"}),
    "two-bars-still-light": NamedScene(
        two_bars, "red and green bars that do not fluctuate at all", {"fluctuation": "none"}
    ),
    "equal-bars": NamedScene(equal_bars, "three green bars alike in all but their fluctuation", {}),
    "rings": NamedScene(rings, "contracting rings, the stimulus that trains the first stage", {"seconds": SECONDS}),
}
"""Every scene that has a name. Options given to `make_scene` win over the fixed ones."""


def scene_names() -> list[str]:
    """The names `make_scene` knows, in the order of the papers."""
    return list(SCENES)


def make_scene(name: str, **options: Any) -> FrameSource:
    """Build the scene `name` with the options of its builder (`seconds`, `fps`, `size`, `phase`, ...).

    Raises:
        InputError: an unknown name, an option this scene does not have, or a value its builder refuses.
    """
    if name not in SCENES:
        raise InputError(f"scene must be one of {', '.join(SCENES)}; got {name!r}")
    scene = SCENES[name]
    known = list(inspect.signature(scene.build).parameters)
    unknown = sorted(set(options) - set(known))
    if unknown:
        raise InputError(f"scene {name} has no option {', '.join(unknown)}; it has {', '.join(known)}")
    source = scene.build(**{**scene.fixed, **options})
    source.name = name
    return source
