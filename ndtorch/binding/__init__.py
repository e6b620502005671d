"""Signals -> objects: the recurrent inhibitory networks, the object table and visual attention."""

from ndtorch.binding.attention import Attention, Enhanced, attention_mask, feature_weights, winner
from ndtorch.binding.config import BindingConfig
from ndtorch.binding.feedback import settled
from ndtorch.binding.first_stage import FirstStage, block_diagonal, train_first_stage
from ndtorch.binding.models.contract import BindingModel, Verdict
from ndtorch.binding.models.published import BindingSignals, BindingState, VisualBinding, second_stage
from ndtorch.binding.models.retinotopic import LocatedObject, RetinotopicBinding, RetinotopicParams, RetinotopicState
from ndtorch.binding.models.scale_free import ScaleFreeStage, StageState
from ndtorch.binding.network import InhibitoryNetwork, NetworkState, alternation, weight_change
from ndtorch.binding.normalise import BindingInputs, FieldInputs, InputState
from ndtorch.binding.objects import BoundObject, ObjectTable, bound_objects, describe
from ndtorch.binding.readout.delays import DelayState, DelayStatistics, Separation, diagonalise, separate
from ndtorch.binding.readout.joined import JoinCriteria, refined_table
from ndtorch.binding.readout.owners import (
    OwnerCriteria,
    SignalStatistics,
    StatisticsState,
    features_by_group,
    owner_table,
)
from ndtorch.binding.readout.weights import object_table
from ndtorch.binding.rules import ACTIVATIONS, RULES, LearningRule, Rule, ScaleFreeRule, learning_onset, learning_rule
from ndtorch.binding.saving import load_state, save_state, to_device
from ndtorch.binding.spectrum import limit_spectral_radius, perron_root, spectral_radius
from ndtorch.binding.theory import (
    Solution,
    count_solutions,
    largest_free_weight,
    mixing_from_weights,
    separated,
    solutions,
)
from ndtorch.binding.tracking.tracks import ObjectFile, ObjectFiles

__all__ = [
    "ACTIVATIONS",
    "RULES",
    "Attention",
    "BindingConfig",
    "BindingInputs",
    "BindingModel",
    "BindingSignals",
    "BindingState",
    "BoundObject",
    "DelayState",
    "DelayStatistics",
    "Enhanced",
    "FieldInputs",
    "FirstStage",
    "InhibitoryNetwork",
    "InputState",
    "JoinCriteria",
    "LearningRule",
    "LocatedObject",
    "NetworkState",
    "ObjectFile",
    "ObjectFiles",
    "ObjectTable",
    "OwnerCriteria",
    "RetinotopicBinding",
    "RetinotopicParams",
    "RetinotopicState",
    "Rule",
    "ScaleFreeRule",
    "ScaleFreeStage",
    "Separation",
    "SignalStatistics",
    "Solution",
    "StageState",
    "StatisticsState",
    "Verdict",
    "VisualBinding",
    "alternation",
    "attention_mask",
    "block_diagonal",
    "bound_objects",
    "count_solutions",
    "describe",
    "diagonalise",
    "feature_weights",
    "features_by_group",
    "largest_free_weight",
    "learning_onset",
    "learning_rule",
    "limit_spectral_radius",
    "load_state",
    "mixing_from_weights",
    "object_table",
    "owner_table",
    "perron_root",
    "refined_table",
    "save_state",
    "second_stage",
    "separate",
    "separated",
    "settled",
    "solutions",
    "spectral_radius",
    "to_device",
    "train_first_stage",
    "weight_change",
    "winner",
]
