"""Signals -> objects: the recurrent inhibitory networks, the object table and visual attention."""

from ndtorch.binding.attention import Attention, Enhanced, attention_mask, feature_weights, winner
from ndtorch.binding.config import BindingConfig
from ndtorch.binding.first_stage import FirstStage, block_diagonal, train_first_stage
from ndtorch.binding.inputs import BindingInputs, InputState
from ndtorch.binding.learning import ACTIVATIONS, RULE_NAMES, LearningRule, learning_onset, learning_rule
from ndtorch.binding.model import BindingSignals, BindingState, Verdict, VisualBinding
from ndtorch.binding.network import InhibitoryNetwork, NetworkState, alternation, weight_change
from ndtorch.binding.objects import BoundObject, ObjectTable, describe, object_table, objects
from ndtorch.binding.resample import Resample, ResampleState
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

__all__ = [
    "ACTIVATIONS",
    "RULE_NAMES",
    "Attention",
    "BindingConfig",
    "BindingInputs",
    "BindingSignals",
    "BindingState",
    "BoundObject",
    "Enhanced",
    "FirstStage",
    "InhibitoryNetwork",
    "InputState",
    "LearningRule",
    "NetworkState",
    "ObjectTable",
    "Resample",
    "ResampleState",
    "Solution",
    "Verdict",
    "VisualBinding",
    "alternation",
    "attention_mask",
    "block_diagonal",
    "count_solutions",
    "describe",
    "feature_weights",
    "largest_free_weight",
    "learning_onset",
    "learning_rule",
    "limit_spectral_radius",
    "load_state",
    "mixing_from_weights",
    "object_table",
    "objects",
    "perron_root",
    "save_state",
    "separated",
    "solutions",
    "spectral_radius",
    "to_device",
    "train_first_stage",
    "weight_change",
    "winner",
]
