"""Insect-inspired vision and navigation in PyTorch.

Start with `ndtorch.load("binding")`, or with the pieces in `ndtorch.vision`, `ndtorch.scenes`, `ndtorch.binding`
and `ndtorch.navigation`. Everything is imported when it is first used.
"""

from typing import TYPE_CHECKING

from ndtorch.lazy import lazy

if TYPE_CHECKING:
    from ndtorch.binding import InhibitoryNetwork, VisualBinding
    from ndtorch.errors import InputError
    from ndtorch.loading import load, model_names
    from ndtorch.navigation import Navigator, StereoRig
    from ndtorch.vision import FEATURES, HassensteinReichardt, HighPass, LowPass, NDMin, OrientedDoG, VisualFeatures

__version__ = "0.1.0"

__all__ = [
    "FEATURES",
    "HassensteinReichardt",
    "HighPass",
    "InhibitoryNetwork",
    "InputError",
    "LowPass",
    "NDMin",
    "Navigator",
    "OrientedDoG",
    "StereoRig",
    "VisualBinding",
    "VisualFeatures",
    "load",
    "model_names",
]

if not TYPE_CHECKING:
    __getattr__ = lazy(
        __name__,
        {
            "ndtorch.binding": ("InhibitoryNetwork", "VisualBinding"),
            "ndtorch.errors": ("InputError",),
            "ndtorch.loading": ("load", "model_names"),
            "ndtorch.navigation": ("Navigator", "StereoRig"),
            "ndtorch.vision": (
                "FEATURES",
                "HassensteinReichardt",
                "HighPass",
                "LowPass",
                "NDMin",
                "OrientedDoG",
                "VisualFeatures",
            ),
        },
        rooms=("binding", "navigation", "scenes", "vision"),
    )
