"""The navigator of a car: made the same way for driving and for replaying."""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass
from typing import Any, Literal

from ndtorch.navigation import (
    CompiledNavigator,
    FeatureParams,
    FloorParams,
    GridMap,
    Navigator,
    Rect,
    StereoRig,
    floor_view,
)

Controller = Literal["ranging", "published"]
AnyNavigator = Navigator | CompiledNavigator

EDGE_REACH, FOLLOW = 4, 3
"""Pixels within which a feature's edge is looked for, and within which it is followed to the next frame."""


@dataclass(frozen=True)
class NavigatorChoice:
    """What can be chosen of a navigator.

    Attributes:
        controller: what steers.
        features: to range in each frame.
        angle: of a pixel, `"atan"` or `"linear"`.
        places: features at edges, to a fraction of a pixel, or where the motion is largest, as published.
        prediction: follow features from frame to frame.
        compiled: step in one compiled function, see `CompiledNavigator`.
    """

    controller: Controller = "ranging"
    features: int = 7
    angle: Literal["atan", "linear"] = "atan"
    places: Literal["edges", "motion"] = "edges"
    prediction: bool = False
    compiled: bool = False

    def fields(self, rig: StereoRig) -> tuple[Rect, Rect]:
        """The rectangles that the controller looks at."""
        return rig.subfields() if self.controller == "published" else floor_view(rig, FloorParams()).rects

    def navigator(self, rig: StereoRig, rate: float, grid_map: GridMap | None = None) -> AnyNavigator:
        """A navigator for so many frames a second."""
        follow = FOLLOW if self.prediction else 0
        edges = self.places == "edges"
        features = FeatureParams(self.features, edge_reach=EDGE_REACH if edges else 0, shared=edges, follow=follow)
        navigator = Navigator(
            rig, 1 / rate, features=features, angles=self.angle, controller=self.controller, grid_map=grid_map
        )
        return CompiledNavigator(navigator, say=say) if self.compiled else navigator

    def configuration(self, rig: StereoRig, rate: float) -> dict[str, Any]:
        """For a recording: everything from which the same navigator can be made again."""
        return {"program": "navigator", "rig": asdict(rig), "rate_hz": rate, **asdict(self)}


def say(line: str) -> None:
    """Tell the user, beside the results."""
    print(f"note: {line}", file=sys.stderr)
