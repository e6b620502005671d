"""Frames -> signals: temporal filters, motion, orientation and the ten features."""

from ndtorch.vision.features import FEATURES, GROUPS, VisualFeatures
from ndtorch.vision.motion import HassensteinReichardt, MotionState
from ndtorch.vision.orientation import ANGLES, OrientedDoG, dog_spectrum
from ndtorch.vision.temporal import (
    FilterState,
    HighPass,
    LowPass,
    RecentMax,
    RecentMaxState,
    low_pass_step,
    smoothing_factor,
)

__all__ = [
    "ANGLES",
    "FEATURES",
    "GROUPS",
    "FilterState",
    "HassensteinReichardt",
    "HighPass",
    "LowPass",
    "MotionState",
    "OrientedDoG",
    "RecentMax",
    "RecentMaxState",
    "VisualFeatures",
    "dog_spectrum",
    "low_pass_step",
    "smoothing_factor",
]
