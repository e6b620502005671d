"""Localisation: dead reckoning corrected by what is ranged, and relocalisation in a map that was made before."""

from ndtorch.navigation.localisation.localiser import Localiser
from ndtorch.navigation.localisation.params import (
    LocaliserParams,
    OdometryParams,
    RelocalisationParams,
    ReplayParams,
    SubmapParams,
)
from ndtorch.navigation.localisation.state import LocaliserState

__all__ = [
    "Localiser",
    "LocaliserParams",
    "LocaliserState",
    "OdometryParams",
    "RelocalisationParams",
    "ReplayParams",
    "SubmapParams",
]
