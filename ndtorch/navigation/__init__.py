"""Rows and frames -> ranges, map and steering: navigation by non-directional motion."""

from ndtorch.navigation.certainty import beam, certainty
from ndtorch.navigation.compiled import CompiledNavigator
from ndtorch.navigation.controllers import (
    CRUISE,
    REVERSE,
    STOPPED,
    SUPPRESSED,
    TURN,
    Command,
    Controller,
    controller_class,
    controller_names,
    make_controller,
)
from ndtorch.navigation.controllers.published import (
    AvoidanceParams,
    AvoidanceState,
    PublishedControl,
    SaccadeAvoidance,
    SubfieldMotion,
)
from ndtorch.navigation.controllers.ranging import RangingControl, RangingParams, RangingState
from ndtorch.navigation.controllers.ranging.floor import FloorSeen, FloorState
from ndtorch.navigation.controllers.ranging.floor_motion import FloorMotion
from ndtorch.navigation.controllers.ranging.floor_view import FloorParams, FloorView, floor_view
from ndtorch.navigation.correspondence import Matches, MatchParams, match_features
from ndtorch.navigation.features import FeatureParams, Features, find_features
from ndtorch.navigation.log_odds import LogOddsMap, LogOddsState
from ndtorch.navigation.mapping import Grid, GridMap, GridMapState
from ndtorch.navigation.model import Navigator, NavigatorState
from ndtorch.navigation.observations import ObservationList, Observations, free_length, path_is_free
from ndtorch.navigation.odometry import DeadReckoning, Pose, drive_step, to_body, to_world
from ndtorch.navigation.options import NavigatorOptions
from ndtorch.navigation.prediction import PredictedFeatures, PredictionState
from ndtorch.navigation.ranging import Ranges, triangulate
from ndtorch.navigation.rig import Rect, StereoRig
from ndtorch.navigation.row_ranging import RowRanging, RowRangingState
from ndtorch.navigation.strips import Strips, cut_strips
from ndtorch.navigation.tracking import AlphaBetaTracker, TrackParams, Tracks

__all__ = [
    "CRUISE",
    "REVERSE",
    "STOPPED",
    "SUPPRESSED",
    "TURN",
    "AlphaBetaTracker",
    "AvoidanceParams",
    "AvoidanceState",
    "Command",
    "CompiledNavigator",
    "Controller",
    "DeadReckoning",
    "FeatureParams",
    "Features",
    "FloorMotion",
    "FloorParams",
    "FloorSeen",
    "FloorState",
    "FloorView",
    "Grid",
    "GridMap",
    "GridMapState",
    "LogOddsMap",
    "LogOddsState",
    "MatchParams",
    "Matches",
    "Navigator",
    "NavigatorOptions",
    "NavigatorState",
    "ObservationList",
    "Observations",
    "Pose",
    "PredictedFeatures",
    "PredictionState",
    "PublishedControl",
    "Ranges",
    "RangingControl",
    "RangingParams",
    "RangingState",
    "Rect",
    "RowRanging",
    "RowRangingState",
    "SaccadeAvoidance",
    "StereoRig",
    "Strips",
    "SubfieldMotion",
    "TrackParams",
    "Tracks",
    "beam",
    "certainty",
    "controller_class",
    "controller_names",
    "cut_strips",
    "drive_step",
    "find_features",
    "floor_view",
    "free_length",
    "make_controller",
    "match_features",
    "path_is_free",
    "to_body",
    "to_world",
    "triangulate",
]
