"""Rows and frames -> ranges, map and steering: navigation by non-directional motion.

Here are the names that people start with; the rest comes from its file. Each is imported when it is first used.
"""

from typing import TYPE_CHECKING

from ndtorch.utils.lazy import lazy

if TYPE_CHECKING:
    from ndtorch.navigation.body import Body
    from ndtorch.navigation.controllers.contract import (
        ARRIVED,
        CRUISE,
        REVERSE,
        STOPPED,
        SUPPRESSED,
        TURN,
        Command,
        Controller,
        controller_names,
        make_controller,
    )
    from ndtorch.navigation.controllers.goal import GoalParams
    from ndtorch.navigation.controllers.published import AvoidanceParams
    from ndtorch.navigation.controllers.ranging.control import RangingParams
    from ndtorch.navigation.localisation.localiser import Localiser
    from ndtorch.navigation.mapping.grid_map import Grid, GridMap
    from ndtorch.navigation.mapping.map_files import load_map, save_map
    from ndtorch.navigation.mapping.observations import AlphaBetaTracker, ObservationList
    from ndtorch.navigation.model import Navigator, NavigatorState
    from ndtorch.navigation.odometry import DeadReckoning, Pose
    from ndtorch.navigation.options import NavigatorOptions
    from ndtorch.navigation.stereo.calibration_files import StereoCalibration, load_calibration
    from ndtorch.navigation.stereo.features import FeatureParams, MatchParams
    from ndtorch.navigation.stereo.ranging import Ranges, StereoRanging
    from ndtorch.navigation.stereo.rig import Rect, StereoRig
    from ndtorch.navigation.stereo.search import SearchParams
    from ndtorch.navigation.stereo.strips import Strips, cut_strips

__all__ = [
    "ARRIVED",
    "CRUISE",
    "REVERSE",
    "STOPPED",
    "SUPPRESSED",
    "TURN",
    "AlphaBetaTracker",
    "AvoidanceParams",
    "Body",
    "Command",
    "Controller",
    "DeadReckoning",
    "FeatureParams",
    "GoalParams",
    "Grid",
    "GridMap",
    "Localiser",
    "MatchParams",
    "Navigator",
    "NavigatorOptions",
    "NavigatorState",
    "ObservationList",
    "Pose",
    "Ranges",
    "RangingParams",
    "Rect",
    "SearchParams",
    "StereoCalibration",
    "StereoRanging",
    "StereoRig",
    "Strips",
    "controller_names",
    "cut_strips",
    "load_calibration",
    "load_map",
    "make_controller",
    "save_map",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy(__name__)
