"""What can be chosen of a navigator: declared here once, for Python, files and command lines."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from ndtorch.errors import InputError
from ndtorch.navigation.body import Body, search_params
from ndtorch.navigation.controllers.contract import Controller, Task
from ndtorch.navigation.controllers.registry import DEFAULT_CONTROLLER, controller_class
from ndtorch.navigation.controllers.scaled import controller_for_body
from ndtorch.navigation.localisation.localiser import Localiser, LocaliserParams
from ndtorch.navigation.localisation.ndt import from_sparse
from ndtorch.navigation.mapping.certainty import SEARCH_SPREAD_PX
from ndtorch.navigation.mapping.grid_map import Certainty, Grid, GridMap
from ndtorch.navigation.mapping.map_files import load_map
from ndtorch.navigation.model import Navigator
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.stereo.features import FeatureParams
from ndtorch.navigation.stereo.rig import AngleModel, Rect, StereoRig
from ndtorch.navigation.stereo.search import SearchParams

EDGE_REACH, FOLLOW = 4, 3
"""Pixels within which a feature's edge is looked for, and within which it is followed to the next frame."""

MOST_FEATURES = 64
"""More to range in a frame are refused: a row has no more edges, and every one costs time."""


@dataclass(frozen=True)
class NavigatorOptions:
    """The options of a navigator. Files and command lines have them under these names.

    Args:
        controller: The controller of this name steers.
        features: This number of features is ranged in each frame; [A] has 5.
        angle: The angle of a pixel is exact (`"atan"`) or linear in its column (`"linear"`, as published).
        feature_position: A feature lies at the edge that moved, with subpixel accuracy (`"edges"`), or where the motion
            is largest (`"motion"`, as published).
        stereo: A few features are matched on both rows (`"features"`, as published), or the right row is searched for
            many places of the left one (`"search"`), where `features`, `feature_position` and `prediction` do nothing;
            `"auto"` is the first for the controller `published`, else the second.
        ahead_share: This share of the ranges, 0 to 1, is reserved for the central 30 degrees, so that thin obstacles
            are not missed.
        prediction: Features are tracked from frame to frame instead of chosen anew, as in [A 2.1.4].
        map_update: The cells of the map hold summed certainty (`"beams"`, as published) or `"log-odds"`.
        goal: The controller `goal` drives to this place, `"X,Y"` in m; X, Y count from the start, heading along X, or
            in the plan of a simulated building.
        explore: The controller `goal` then explores what it has not visited.
        return_home: The controller `goal` then returns to the start.
        speed: The car drives at this speed where nothing is in its path, m/s; scaled with the size of the body.
        localise: Scan matching corrects dead reckoning, and the map is made with the corrected poses.
        known_map: The car localises in the `map.npz` of this path, which a drive with `localise` has made.
        map_start: Pose at which the car starts in the known map, `"X,Y,DEGREES"`; by default where the drive that made
            the map started.

    Raises:
        InputError: an unknown controller or word, or a number out of range.
    """

    controller: str = DEFAULT_CONTROLLER
    features: int = 7
    angle: AngleModel = "atan"
    feature_position: Literal["edges", "motion"] = "edges"
    stereo: Literal["auto", "features", "search"] = "auto"
    ahead_share: float = 0.0
    prediction: bool = False
    map_update: Certainty = "beams"
    goal: str = ""
    explore: bool = False
    return_home: bool = False
    speed: float = 0.5
    localise: bool = False
    known_map: str = ""
    map_start: str = ""

    def __post_init__(self) -> None:
        for option in dataclasses.fields(NavigatorOptions):
            check_option(option.name, getattr(self, option.name))
        goal, reach = place_of(self.goal), LocaliserParams().map_radius_m
        if (self.localise or self.known_map) and goal is not None and max(map(abs, goal)) >= reach:
            raise InputError(
                f"the map of localise reaches {reach:g} m from 0,0 along x and y: goal {self.goal} is beyond"
            )

    def fields(self, rig: StereoRig, body: Body | None = None) -> tuple[Rect, Rect]:
        """The rectangles that the controller looks at."""
        return self.make(rig, 1 / 30, body).fields

    def start_pose(self) -> Pose | None:
        """Where the car starts in a known map; None without one."""
        if not self.known_map:
            return None
        x, y, degrees = numbers_of("map_start", self.map_start or "0,0,0", "X,Y,DEGREES", "3,-1.5,90")
        return Pose(x, y, math.radians(degrees))

    def task(self) -> Task:
        """What the controller is asked to do."""
        return Task(place_of(self.goal), self.explore, self.return_home, self.speed)

    def make(self, rig: StereoRig, dt: float, body: Body | None = None) -> Controller:
        """The controller.

        Raises:
            InputError: it cannot do what it is asked to.
        """
        params = controller_class(self.controller).params_for(self.task())
        return controller_for_body(self.controller, rig, dt, body or Body(), params)

    def search(self, rig: StereoRig, body: Body | None = None) -> SearchParams | None:
        """How the right row is searched, if it is."""
        searches = controller_class(self.controller).checks_near if self.stereo == "auto" else self.stereo == "search"
        if not searches:
            return None
        # Cameras hand over the horizon row alone.
        found = SearchParams(rows=1) if body is None else search_params(rig, body)
        return dataclasses.replace(found, ahead_count=round(self.ahead_share * SearchParams.count))

    def navigator(
        self,
        rig: StereoRig,
        rate: float,
        grid: Grid | None = None,
        near_check: bool = True,
        body: Body | None = None,
    ) -> Navigator:
        """A navigator for so many frames a second.

        Args:
            grid: the part of the world to map, if any.
            near_check: see `Navigator`.
            body: of the robot; the car of [A] by default.
        """
        edges = self.feature_position == "edges"
        features = FeatureParams(
            self.features,
            edge_reach_px=EDGE_REACH if edges else 0,
            shared=edges,
            follow_reach_px=FOLLOW if self.prediction else 0,
            ahead_count=round(self.ahead_share * self.features),
        )
        search = self.search(rig, body)
        spread = 1.0 if search is None else SEARCH_SPREAD_PX
        grid_map = None if grid is None else GridMap(rig, grid, certainty=self.map_update, spread_px=spread)
        return Navigator(
            rig,
            1 / rate,
            controller=self.controller,
            params=controller_class(self.controller).params_for(self.task()),
            features=features,
            angles=self.angle,
            search=search,
            grid_map=grid_map,
            near_check=near_check,
            localiser=self.localiser(rig, rate),
            body=body,
        )

    def localiser(self, rig: StereoRig, rate: float) -> Localiser | None:
        """The localiser, or None.

        Raises:
            InputError: a known map that cannot be read, or was made without `localise`.
        """
        if not self.known_map:
            return Localiser(rig, 1 / rate) if self.localise else None
        cells = load_map(Path(self.known_map)).ndt_cells
        if cells is None or not len(cells):
            raise InputError(f"known_map {self.known_map} has no NDT cells: make it with localise")
        return Localiser(rig, 1 / rate, known=from_sparse(cells, LocaliserParams().map_cells))


FASTEST = 1.0
"""m/s: what [A] gives for the car."""

OPTION_NAMES = tuple(option.name for option in dataclasses.fields(NavigatorOptions))
"""The names of all options, in order."""

WORDS: Mapping[str, tuple[str, ...]] = {
    "angle": ("atan", "linear"),
    "feature_position": ("edges", "motion"),
    "stereo": ("auto", "features", "search"),
    "map_update": ("beams", "log-odds"),
}


def check_option(name: str, value: Any) -> None:
    """Raise `InputError` where an option of `NavigatorOptions` cannot have a value."""
    if name == "controller":
        controller_class(value)
    elif name == "features" and not (type(value) is int and 1 <= value <= MOST_FEATURES):
        raise InputError(f"features must be a whole number from 1 to {MOST_FEATURES}, got {value!r}")
    elif name in WORDS and value not in WORDS[name]:
        raise InputError(f"{name} must be {' or '.join(map(repr, WORDS[name]))}, got {value!r}")
    elif name == "known_map" and not isinstance(value, str):
        raise InputError(f"known_map must be the name of a file, got {value!r}")
    elif name == "goal":
        place_of(value)
    elif name == "map_start" and value:
        numbers_of(name, value, "X,Y,DEGREES", "3,-1.5,90")
    elif name == "speed" and not (isinstance(value, int | float) and 0.1 <= value <= FASTEST):
        raise InputError(f"speed must be from 0.1 to {FASTEST} m/s, got {value!r}")
    elif name == "ahead_share" and not (isinstance(value, int | float) and 0 <= value <= 1):
        raise InputError(f"ahead_share must be from 0 to 1, got {value!r}")
    elif name in ("prediction", "explore", "return_home", "localise") and not isinstance(value, bool):
        raise InputError(f"{name} must be true or false, got {value!r}")


def place_of(text: Any) -> tuple[float, float] | None:
    """The place in "X,Y"; None for an empty text.

    Raises:
        InputError: anything else.
    """
    if text == "":
        return None
    x, y = numbers_of("goal", text, "X,Y", "3,-1.5")
    return x, y


def numbers_of(name: str, text: Any, form: str, example: str) -> list[float]:
    """The numbers of an option of comma-separated ones.

    Raises:
        InputError: anything else.
    """
    try:
        numbers = [float(part) for part in text.split(",")]
    except (ValueError, AttributeError):
        numbers = []
    if len(numbers) != form.count(",") + 1 or not all(map(math.isfinite, numbers)):
        raise InputError(f'{name} must be "{form}" in m, for instance "{example}", got {text!r}')
    return numbers


def options_of(values: Mapping[str, Any]) -> NavigatorOptions:
    """The options among the keys of a mapping; other keys do not matter."""
    return NavigatorOptions(**{name: values[name] for name in OPTION_NAMES if name in values})
