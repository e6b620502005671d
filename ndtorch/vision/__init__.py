"""Frames -> signals: filters over time, detectors of motion, small targets and looming, orientation, the ten features;
speed of image rows."""

from ndtorch.vision.barlow_levick import BarlowLevick, VetoState
from ndtorch.vision.chahl_srinivasan import ChahlSrinivasan, ShiftState, row_shift
from ndtorch.vision.features import FEATURES, GROUPS, VisualFeatures
from ndtorch.vision.looming import LoomingDetector, LoomingState
from ndtorch.vision.motion import HassensteinReichardt, MotionState
from ndtorch.vision.nondirectional import (
    NDS,
    SPEED_SCALE,
    DirectionalND,
    DirectionalState,
    NDMin,
    NDMinus,
    NDSState,
    SpeedCurve,
    judge_speed_curve,
    spatial_maximum,
    speed_response,
)
from ndtorch.vision.orientation import ANGLES, OrientedDoG, dog_spectrum
from ndtorch.vision.receptive_fields import LocalFeatures, field_weights
from ndtorch.vision.sequential import Sequential, SequentialState
from ndtorch.vision.small_target import SmallTargetDetector, SmallTargetState
from ndtorch.vision.temporal import (
    FilterState,
    HighPass,
    LowPass,
    RecentMaxState,
    Resample,
    ResampleState,
    RunningMax,
    low_pass_step,
    smoothing_factor,
)
from ndtorch.vision.tuning import TuningCurve, tuning_curve

__all__ = [
    "ANGLES",
    "FEATURES",
    "GROUPS",
    "NDS",
    "SPEED_SCALE",
    "BarlowLevick",
    "ChahlSrinivasan",
    "DirectionalND",
    "DirectionalState",
    "FilterState",
    "HassensteinReichardt",
    "HighPass",
    "LocalFeatures",
    "LoomingDetector",
    "LoomingState",
    "LowPass",
    "MotionState",
    "NDMin",
    "NDMinus",
    "NDSState",
    "OrientedDoG",
    "RecentMaxState",
    "Resample",
    "ResampleState",
    "RunningMax",
    "Sequential",
    "SequentialState",
    "ShiftState",
    "SmallTargetDetector",
    "SmallTargetState",
    "SpeedCurve",
    "TuningCurve",
    "VetoState",
    "VisualFeatures",
    "dog_spectrum",
    "field_weights",
    "judge_speed_curve",
    "low_pass_step",
    "row_shift",
    "smoothing_factor",
    "spatial_maximum",
    "speed_response",
    "tuning_curve",
]
