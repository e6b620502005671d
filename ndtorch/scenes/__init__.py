"""Frames to feed the front end: simulated scenes and real video."""

from typing import TYPE_CHECKING

from ndtorch.utils.lazy import lazy

if TYPE_CHECKING:
    from ndtorch.scenes.bar_scenes import (
        BLUE,
        DEFAULT_PHASE,
        GREEN,
        RED,
        equal_bars,
        one_bar,
        three_bars,
        two_bars,
    )
    from ndtorch.scenes.bars import Bar, BarScene
    from ndtorch.scenes.base import FrameSource, RenderedScene
    from ndtorch.scenes.fluctuation import Distance, Fluctuation, RandomShadow, SineShadow
    from ndtorch.scenes.named import SCENES, NamedScene, make_scene
    from ndtorch.scenes.patterns import (
        Pattern,
        counterphase_grating,
        edge,
        flash,
        flicker,
        grating,
        looming_disc,
        panned_picture,
        plaid,
        random_dots,
        rings,
    )
    from ndtorch.scenes.stimuli import hsl_color, moving_bar, static_bar
    from ndtorch.scenes.video import VideoSource, open_video
    from ndtorch.scenes.video_writer import VideoWriter

__all__ = [
    "BLUE",
    "DEFAULT_PHASE",
    "GREEN",
    "RED",
    "SCENES",
    "Bar",
    "BarScene",
    "Distance",
    "Fluctuation",
    "FrameSource",
    "NamedScene",
    "Pattern",
    "RandomShadow",
    "RenderedScene",
    "SineShadow",
    "VideoSource",
    "VideoWriter",
    "counterphase_grating",
    "edge",
    "equal_bars",
    "flash",
    "flicker",
    "grating",
    "hsl_color",
    "looming_disc",
    "make_scene",
    "moving_bar",
    "one_bar",
    "open_video",
    "panned_picture",
    "plaid",
    "random_dots",
    "rings",
    "static_bar",
    "three_bars",
    "two_bars",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy(__name__)
