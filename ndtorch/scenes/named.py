"""Scenes by name, for command lines and tables of runs."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

from ndtorch.errors import InputError, did_you_mean

if TYPE_CHECKING:
    from ndtorch.scenes.base import FrameSource


SECONDS = 19.0
"""Of a scene, as in the papers: the published model settles for four and learns for fifteen."""


class NamedScene(NamedTuple):
    """Builder of a scene, what it shows in one line, and the options it fixes.

    The builder is named, not imported: a list of scenes has to be there before torch is.
    """

    builder: str
    description: str
    fixed: Mapping[str, Any]

    @property
    def build(self) -> Callable[..., FrameSource]:
        """The function that makes the scene."""
        module, name = self.builder.split(":")
        found: Callable[..., FrameSource] = getattr(import_module(f"ndtorch.scenes.{module}"), name)
        return found


SCENES: dict[str, NamedScene] = {
    "one-bar": NamedScene("bar_scenes:one_bar", "a red bar moving through sine shadow", {}),
    "two-bars": NamedScene("bar_scenes:two_bars", "the reference stimulus: red and green bars in sine shadow", {}),
    "three-bars": NamedScene("bar_scenes:three_bars", "the reference stimulus and a blue bar moving left", {}),
    "two-bars-distance": NamedScene(
        "bar_scenes:two_bars", "red and green bars that come nearer and go away, no shadow", {"fluctuation": "distance"}
    ),
    "two-bars-random": NamedScene(
        "bar_scenes:two_bars", "red and green bars in a random dappled shadow", {"fluctuation": "random"}
    ),
    "two-bars-still-light": NamedScene(
        "bar_scenes:two_bars", "red and green bars that do not fluctuate at all", {"fluctuation": "none"}
    ),
    "equal-bars": NamedScene("bar_scenes:equal_bars", "three green bars alike in all but their fluctuation", {}),
    "rings": NamedScene(
        "stimuli:rings", "contracting rings, the stimulus that trains the first stage", {"seconds": SECONDS}
    ),
}
"""Every scene that has a name. Options given to `make_scene` win over the fixed ones."""


def scene_names() -> list[str]:
    """The names `make_scene` knows, in the order of the papers.

    >>> scene_names()[:3]
    ['one-bar', 'two-bars', 'three-bars']
    """
    return list(SCENES)


def make_scene(name: str, **options: Any) -> FrameSource:
    """Build the scene `name` with the options of its builder (`seconds`, `fps`, `size`, `phase`, ...).

    Raises:
        InputError: an unknown name, an option this scene does not have, or a value its builder refuses.

    >>> make_scene('two-bars', seconds=1.0, phase=60).length
    100
    """
    if not isinstance(name, str) or name not in SCENES:
        raise InputError(f"scene must be one of {', '.join(SCENES)}; got {name!r}{did_you_mean(name, SCENES)}")
    scene = SCENES[name]
    known = list(inspect.signature(scene.build).parameters)
    unknown = sorted(set(options) - set(known))
    if unknown:
        raise InputError(f"scene {name} has no option {', '.join(unknown)}; it has {', '.join(known)}")
    source = scene.build(**{**scene.fixed, **options})
    source.name = name
    return source
