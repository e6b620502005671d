"""Everything public has a property that is tried."""

from __future__ import annotations

import inspect

from torch import nn

from tests.properties import PUBLIC
from tests.test_properties import PARTS
from tests.test_properties_functions import FUNCTIONS
from tests.test_properties_numbers import CLASSES


def test_nothing_public_is_left_out() -> None:
    """A new module needs its `Part`, a new function its property; what only holds numbers is tried as it is."""
    public = {name: getattr(module, name) for module in PUBLIC for name in module.__all__}
    left = {
        name
        for name, thing in public.items()
        if inspect.isfunction(thing)
        or (inspect.isclass(thing) and not issubclass(thing, tuple) and not inspect.isabstract(thing))
    }
    asked = {*PARTS, *FUNCTIONS, *CLASSES, *HELD_BY}
    assert sorted(left - asked) == []
    assert sorted(name for name in asked if name not in public) == []
    modules = {name for name, thing in public.items() if inspect.isclass(thing) and issubclass(thing, nn.Module)}
    assert modules - set(PARTS) == {"BindingModel", "SaccadeController"}


HELD_BY = {
    "ForegroundModel": "tests/binding/models/test_foreground.py",
    "Localiser": "tests/navigation/localisation",
    "load_map": "tests/navigation/mapping",
    "save_map": "tests/navigation/mapping",
    "BoundObject": "bound_objects",
    "LearningRule": "learning_rule",
}
"""What is made within another property, or has tests of its own, and where."""
