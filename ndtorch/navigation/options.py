"""What can be chosen of a navigator: one dataclass for Python, files and command lines, imported without torch."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args, get_type_hints

from ndtorch.errors import InputError

if TYPE_CHECKING:
    from ndtorch.navigation.body import Body
    from ndtorch.navigation.localisation.localiser import Localiser
    from ndtorch.navigation.mapping.grid_map import Grid
    from ndtorch.navigation.model import Navigator
    from ndtorch.navigation.odometry import Pose
    from ndtorch.navigation.stereo.rig import Rect, StereoRig

EDGE_REACH = 4  # pixels within which a feature's edge is looked for


@dataclass(frozen=True)
class NavigatorOptions:
    """The options of a navigator. Files and command lines have them under these names.

    Raises:
        InputError: an unknown controller or word, or a number out of range.
    """

    controller: str = "ranging"
    """Controller: published, ranging or goal."""
    features: int = 7
    """Number of features that are ranged in each frame, 1 to 32; [A] has 5."""
    angle: Literal["atan", "linear"] = "atan"
    """Angle of a pixel: exact (atan), or linear in its column (linear, as published)."""
    feature_position: Literal["edges", "motion"] = "edges"
    """Place of a feature: the edge that moved, to a fraction of a pixel (edges), or the largest motion (motion, as
    published)."""
    stereo: Literal["auto", "features", "search"] = "auto"
    """Ranging: a few features matched on both rows (features, as published), a search of the right row for many places
    of the left one (search, without features and feature_position), or the first for the controller published and
    else the second (auto)."""
    map_update: Literal["beams", "log-odds"] = "beams"
    """Cells of the map: summed certainty (beams, as published) or log-odds."""
    goal: str = ""
    """Place to drive to with the controller goal, X,Y in m from the start, heading along X, or in the plan of a
    simulated building."""
    explore: bool = False
    """The controller goal then explores what it has not visited."""
    return_home: bool = False
    """The controller goal then returns to the start."""
    speed: float = 0.5
    """Speed where nothing is in the path, m/s, 0.1 to 1; scaled with the size of the body."""
    localise: bool = False
    """Scan matching corrects dead reckoning, and the map is made with the corrected poses."""
    known_map: str = ""
    """Path of the map.npz of a drive with localise; the car localises in it."""
    map_start: str = ""
    """Pose at which the car starts in the known map, X,Y,DEGREES; by default where the drive that made it started."""

    def __post_init__(self) -> None:
        from ndtorch.navigation.controllers.contract import controller_class

        for name, kind in KINDS.items():
            words, value = get_args(kind), getattr(self, name)
            if value not in words if words else not isinstance(value, (int, float) if kind is float else kind):
                raise InputError(f"{name} must be {' or '.join(map(repr, words)) or kind.__name__}, got {value!r}")
        # A row has no more edges, and [A] gives 1 m/s for the car.
        if not (1 <= self.features <= 32 and 0.1 <= self.speed <= 1.0):
            got = self.features, self.speed
            raise InputError(f"features must be a whole number 1 to 32 and speed 0.1 to 1, got {got}")
        controller_class(self.controller)
        place_of(self.goal)
        pose_of(self.map_start)

    def fields(self, rig: StereoRig, body: Body | None = None) -> tuple[Rect, Rect]:
        """The rectangles that the controller looks at."""
        from ndtorch.navigation.controllers.contract import make_controller

        return make_controller(self.controller, rig, 1 / 30, self.params(), body=body).fields

    def start_pose(self) -> Pose | None:
        """Where the car starts in a known map; None without one."""
        return pose_of(self.map_start) if self.known_map else None

    def params(self) -> Any:
        """Parameters of the controller for what it is asked to do; raises `InputError` where it cannot do so."""
        from ndtorch.navigation.controllers.contract import controller_class

        kind, goal = controller_class(self.controller), place_of(self.goal)
        return kind.params_for(self.speed, goal=goal, explore=self.explore, return_home=self.return_home)

    def navigator(
        self, rig: StereoRig, rate: float, grid: Grid | None = None, near_check: bool = True, body: Body | None = None
    ) -> Navigator:
        """A navigator for so many frames a second.

        Args:
            grid: the part of the world to map, if any.
            near_check: see `Navigator`.
            body: of the robot; the car of [A] by default.
        """
        from ndtorch.navigation.body import Body
        from ndtorch.navigation.controllers.contract import controller_class
        from ndtorch.navigation.mapping.certainty import SEARCH_SPREAD_PX
        from ndtorch.navigation.mapping.grid_map import GridMap
        from ndtorch.navigation.model import Navigator
        from ndtorch.navigation.stereo.features import FeatureParams
        from ndtorch.navigation.stereo.search import SearchParams

        edges = self.feature_position == "edges"
        searches = controller_class(self.controller).checks_near if self.stereo == "auto" else self.stereo == "search"
        spread = SEARCH_SPREAD_PX if searches else 1.0
        return Navigator(
            rig,
            1 / rate,
            controller=self.controller,
            params=self.params(),
            features=FeatureParams(self.features, edge_reach_px=EDGE_REACH if edges else 0, shared=edges),
            angles=self.angle,
            search=SearchParams.for_body(rig, body or Body()) if searches else None,
            grid_map=None if grid is None else GridMap(rig, grid, certainty=self.map_update, spread_px=spread),
            near_check=near_check,
            localiser=self.localiser(rig, rate),
            body=body,
        )

    def localiser(self, rig: StereoRig, rate: float) -> Localiser | None:
        """The localiser, or None; raises `InputError` for a known map without NDT cells and a goal beyond the map."""
        if not (self.localise or self.known_map):
            return None
        from ndtorch.navigation.localisation.localiser import CELL_M, MAP_CELLS, Localiser
        from ndtorch.navigation.localisation.ndt import from_sparse
        from ndtorch.navigation.mapping.map_files import load_map

        goal, reach = place_of(self.goal), MAP_CELLS // 2 * CELL_M
        if goal is not None and max(map(abs, goal)) >= reach:
            raise InputError(f"the map of localise reaches {reach:g} m from 0,0: goal {self.goal} is beyond")
        if not self.known_map:
            return Localiser(rig, 1 / rate)
        cells = load_map(Path(self.known_map)).ndt_cells
        if cells is None or not len(cells):
            raise InputError(f"known_map {self.known_map} has no NDT cells: make it with localise")
        return Localiser(rig, 1 / rate, known=from_sparse(cells, MAP_CELLS))


KINDS = get_type_hints(NavigatorOptions)
OPTION_NAMES = tuple(KINDS)  # the names of all options, in order


def place_of(text: str) -> tuple[float, float] | None:
    """The place in "X,Y", None for an empty text; raises `InputError` for anything else."""
    if text == "":
        return None
    x, y = numbers_of("goal", text, "X,Y", "3,-1.5")
    return x, y


def pose_of(text: str) -> Pose:
    """The pose in "X,Y,DEGREES", the origin for an empty text; raises `InputError` for anything else."""
    from ndtorch.navigation.odometry import Pose

    x, y, degrees = numbers_of("map_start", text or "0,0,0", "X,Y,DEGREES", "3,-1.5,90")
    return Pose(x, y, math.radians(degrees))


def numbers_of(name: str, text: str, form: str, example: str) -> list[float]:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != form.count(",") + 1 or not all(map(math.isfinite, numbers)):
        raise InputError(f'{name} must be "{form}" in m, for instance "{example}", got {text!r}')
    return numbers


def options_of(values: Mapping[str, Any]) -> NavigatorOptions:
    """The options among the keys of a mapping; other keys do not matter."""
    return NavigatorOptions(**{name: values[name] for name in OPTION_NAMES if name in values})
