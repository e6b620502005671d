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
        found: Callable[..., FrameSource] = getattr(import_module("ndtorch.scenes"), self.builder)
        return found


SCENES: dict[str, NamedScene] = {
    "one-bar": NamedScene("one_bar", "a red bar moving through sine shadow", {}),
    "two-bars": NamedScene("two_bars", "the reference stimulus: red and green bars in sine shadow", {}),
    "three-bars": NamedScene("three_bars", "the reference stimulus and a blue bar moving left", {}),
    "two-bars-distance": NamedScene(
        "two_bars", "red and green bars that come nearer and go away, no shadow", {"fluctuation": "distance"}
    ),
    "two-bars-random": NamedScene(
        "two_bars", "red and green bars in a random dappled shadow", {"fluctuation": "random"}
    ),
    "two-bars-still-light": NamedScene(
        "two_bars", "red and green bars that do not fluctuate at all", {"fluctuation": "none"}
    ),
    "equal-bars": NamedScene("equal_bars", "three green bars alike in all but their fluctuation", {}),
    "rings": NamedScene("rings", "contracting rings, the stimulus that trains the first stage", {"seconds": SECONDS}),
    "grating": NamedScene("grating", "a drifting grating, sine or square", {}),
    "counterphase-grating": NamedScene("counterphase_grating", "a standing grating that reverses", {}),
    "plaid": NamedScene("plaid", "two drifting gratings at an angle", {}),
    "on-edge": NamedScene("edge", "a bright edge that crosses the image", {"polarity": "on"}),
    "off-edge": NamedScene("edge", "a dark edge that crosses the image", {"polarity": "off"}),
    "flash": NamedScene("flash", "a flash of the whole field", {}),
    "flicker": NamedScene("flicker", "flicker of the whole field", {}),
    "moving-bar": NamedScene("moving_bar", "a white bar that moves across its long axis", {"direction": 0.0}),
    "looming-disc": NamedScene("looming_disc", "a dark disc on a collision course", {}),
    "receding-disc": NamedScene("looming_disc", "the looming disc backwards", {"receding": True}),
    "random-dots": NamedScene("random_dots", "dots that move together, or a share of them", {}),
    "panned-picture": NamedScene("panned_picture", "a picture, or 1/f noise, that moves past", {}),
}
"""Every scene that has a name. Options given to `make_scene` win over the fixed ones."""


def make_scene(name: str, **options: Any) -> FrameSource:
    """Build the scene `name` with the options of its builder (`seconds`, `fps`, `size`, `phase`, ...).

    Raises:
        InputError: an unknown name, an option this scene does not have, or a value its builder refuses.

    >>> make_scene('two-bars', seconds=1.0, phase=60).length
    100
    """
    from ndtorch.scenes.bars import BarOptions
    from ndtorch.scenes.patterns import Screen

    if not isinstance(name, str) or name not in SCENES:
        raise InputError(f"scene must be one of {', '.join(SCENES)}; got {name!r}{did_you_mean(name, SCENES)}")
    scene = SCENES[name]
    own = inspect.signature(scene.build).parameters
    shared = BarOptions if "options" in own else Screen
    known = [key for key in own if key not in ("options", "screen")] + list(shared.__annotations__)
    unknown = sorted(set(options) - set(known))
    if unknown:
        hint = did_you_mean(unknown[0], known) or f"; it has {', '.join(known)}"
        raise InputError(f"scene {name} has no option {', '.join(unknown)}{hint}")
    try:
        source = scene.build(**{**scene.fixed, **options})
    except (TypeError, ValueError) as error:  # an option of another kind than the builder takes
        if isinstance(error, InputError):
            raise
        raise InputError(f"scene {name}: {error}") from error
    source.name = name
    return source
