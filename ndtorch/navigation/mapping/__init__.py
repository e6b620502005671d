"""Maps of what was ranged: a grid of certainties or log-odds, a list of observations, tracks, and files."""

from ndtorch.navigation.mapping.feature_tracks import AlphaBetaTracker
from ndtorch.navigation.mapping.grid_map import Certainty, Grid, GridMap, GridMapState, LogOdds
from ndtorch.navigation.mapping.map_files import SavedMap, load_map, save_map
from ndtorch.navigation.mapping.observations import ObservationList

__all__ = [
    "AlphaBetaTracker",
    "Certainty",
    "Grid",
    "GridMap",
    "GridMapState",
    "LogOdds",
    "ObservationList",
    "SavedMap",
    "load_map",
    "save_map",
]
