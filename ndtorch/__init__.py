"""Insect-inspired vision and navigation in PyTorch.

Start with `ndtorch.load("binding")`, or with the pieces in `ndtorch.vision`, `ndtorch.scenes`, `ndtorch.binding`
and `ndtorch.navigation`.
"""

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
