"""Where the car is: dead reckoning corrected by what is ranged, and finding itself in a map that was made before."""

from ndtorch.navigation.localisation.localiser import Localiser
from ndtorch.navigation.localisation.params import LocaliserParams
from ndtorch.navigation.localisation.state import LocaliserState

__all__ = ["Localiser", "LocaliserParams", "LocaliserState"]
