"""The controller that drives where it has seen floor: `control` is its step, the other files are its parts."""

from ndtorch.navigation.controllers.ranging._kernels import RangingState
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.controllers.ranging.params import RangingParams

__all__ = ["RangingControl", "RangingParams", "RangingState"]
