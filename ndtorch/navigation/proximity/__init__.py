"""Proximity check: obstacles nearer than the ranging sees, by stereo matching and by the consistency of the floor."""

from ndtorch.navigation.proximity.params import ProximityParams
from ndtorch.navigation.proximity.stereo_match import Obstacles, ProximityScan

__all__ = ["Obstacles", "ProximityParams", "ProximityScan"]
