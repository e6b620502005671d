"""Localisation: odometry corrected by matching what is ranged with a map that is made on the way or known before."""

from ndtorch.navigation.localisation.localiser import Localiser, LocaliserParams, LocaliserState

__all__ = ["Localiser", "LocaliserParams", "LocaliserState"]
