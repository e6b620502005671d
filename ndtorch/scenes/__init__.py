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
    from ndtorch.scenes.base import FrameSource
    from ndtorch.scenes.dots import CommonFate, common_fate
    from ndtorch.scenes.fluctuation import Distance, Fluctuation, NoFluctuation, RandomShadow, SineShadow
    from ndtorch.scenes.gratings import FlickeringGrating, MovingGrating
    from ndtorch.scenes.named import SCENES, NamedScene, make_scene, scene_names
    from ndtorch.scenes.rendered import RenderedScene
    from ndtorch.scenes.ring_scene import Rings, rings
    from ndtorch.scenes.tuning import hsl_color, moving_bar, static_bar
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
    "CommonFate",
    "Distance",
    "FlickeringGrating",
    "Fluctuation",
    "FrameSource",
    "MovingGrating",
    "NamedScene",
    "NoFluctuation",
    "RandomShadow",
    "RenderedScene",
    "Rings",
    "SineShadow",
    "VideoSource",
    "VideoWriter",
    "common_fate",
    "equal_bars",
    "hsl_color",
    "make_scene",
    "moving_bar",
    "one_bar",
    "open_video",
    "rings",
    "scene_names",
    "static_bar",
    "three_bars",
    "two_bars",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy(
        __name__,
        {
            "ndtorch.scenes.bar_scenes": (
                "BLUE",
                "DEFAULT_PHASE",
                "GREEN",
                "RED",
                "equal_bars",
                "one_bar",
                "three_bars",
                "two_bars",
            ),
            "ndtorch.scenes.bars": (
                "Bar",
                "BarScene",
            ),
            "ndtorch.scenes.base": ("FrameSource",),
            "ndtorch.scenes.dots": (
                "CommonFate",
                "common_fate",
            ),
            "ndtorch.scenes.fluctuation": (
                "Distance",
                "Fluctuation",
                "NoFluctuation",
                "RandomShadow",
                "SineShadow",
            ),
            "ndtorch.scenes.gratings": (
                "FlickeringGrating",
                "MovingGrating",
            ),
            "ndtorch.scenes.named": (
                "SCENES",
                "NamedScene",
                "make_scene",
                "scene_names",
            ),
            "ndtorch.scenes.rendered": ("RenderedScene",),
            "ndtorch.scenes.ring_scene": (
                "Rings",
                "rings",
            ),
            "ndtorch.scenes.tuning": (
                "hsl_color",
                "moving_bar",
                "static_bar",
            ),
            "ndtorch.scenes.video": (
                "VideoSource",
                "open_video",
            ),
            "ndtorch.scenes.video_writer": ("VideoWriter",),
        },
        explain=True,
    )
