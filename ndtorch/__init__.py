"""Insect-inspired vision and navigation in PyTorch.

Start with `ndtorch.load("published")`, or with the pieces in `ndtorch.vision`, `ndtorch.scenes`, `ndtorch.binding`
and `ndtorch.navigation`. Everything is imported when it is first used.
"""

from typing import TYPE_CHECKING

from ndtorch.utils.lazy import lazy

if TYPE_CHECKING:
    from ndtorch.binding import BindingModel, InhibitoryNetwork
    from ndtorch.errors import InputError
    from ndtorch.loading import load, model_names
    from ndtorch.navigation import Navigator, StereoRig
    from ndtorch.vision import FEATURES, HassensteinReichardt, NDMin, OrientedDoG, Sequential, VisualFeatures

__version__ = "0.2.0"

__all__ = [
    "FEATURES",
    "BindingModel",
    "HassensteinReichardt",
    "InhibitoryNetwork",
    "InputError",
    "NDMin",
    "Navigator",
    "OrientedDoG",
    "Sequential",
    "StereoRig",
    "VisualFeatures",
    "load",
    "model_names",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy(
        __name__,
        submodules=("binding", "navigation", "scenes", "vision"),
    )
