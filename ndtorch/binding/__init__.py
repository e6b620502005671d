"""Signals -> objects: models, the networks and rules they are made of, read-outs, attention and theory.

These are the names people start with; the rest is in the files.
"""

from ndtorch.binding.attention import Attention
from ndtorch.binding.first_stage import FirstStage, train_first_stage
from ndtorch.binding.models.base import BindingModel, Verdict
from ndtorch.binding.models.foreground import ForegroundModel
from ndtorch.binding.models.retinotopic import RetinotopicModel
from ndtorch.binding.models.whole_field import PublishedModel, ScaleFreeModel
from ndtorch.binding.network import InhibitoryNetwork, alternation, weight_change
from ndtorch.binding.normalise import BindingInputs
from ndtorch.binding.object_files import ObjectFiles
from ndtorch.binding.objects import BoundObject, ObjectTable, bound_objects, describe, object_table
from ndtorch.binding.rules import ACTIVATIONS, RULES, LearningRule, learning_rule
from ndtorch.binding.saving import load_state, save_state, to_device
from ndtorch.binding.spectrum import limit_spectral_radius, spectral_radius
from ndtorch.binding.theory import separated, solutions

__all__ = [
    "ACTIVATIONS",
    "RULES",
    "Attention",
    "BindingInputs",
    "BindingModel",
    "BoundObject",
    "FirstStage",
    "ForegroundModel",
    "InhibitoryNetwork",
    "LearningRule",
    "ObjectFiles",
    "ObjectTable",
    "PublishedModel",
    "RetinotopicModel",
    "ScaleFreeModel",
    "Verdict",
    "alternation",
    "bound_objects",
    "describe",
    "learning_rule",
    "limit_spectral_radius",
    "load_state",
    "object_table",
    "save_state",
    "separated",
    "solutions",
    "spectral_radius",
    "to_device",
    "train_first_stage",
    "weight_change",
]
