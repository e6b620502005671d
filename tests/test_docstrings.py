"""Examples in docstrings of public names work as they stand there."""

from __future__ import annotations

import doctest
import inspect

import pytest
import torch

import ndtorch
import ndtorch.binding
import ndtorch.navigation
import ndtorch.scenes
import ndtorch.vision

PACKAGES = [ndtorch, ndtorch.vision, ndtorch.scenes, ndtorch.binding, ndtorch.navigation]
PUBLIC = {id(thing): thing for package in PACKAGES for thing in (getattr(package, name) for name in package.__all__)}
EXAMPLES = {
    test.name: test
    for thing in PUBLIC.values()
    if inspect.isclass(thing) or inspect.isfunction(thing)
    for test in doctest.DocTestFinder(exclude_empty=True).find(
        thing, f"{thing.__module__}.{thing.__qualname__}", globs={"torch": torch, thing.__name__: thing}
    )
    if test.examples
}


@pytest.mark.parametrize("name", sorted(EXAMPLES))
def test_an_example_prints_what_it_says(name: str) -> None:
    told: list[str] = []
    result = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(EXAMPLES[name], out=told.append)
    assert result.attempted > 0
    assert result.failed == 0, "".join(told)


def test_examples_are_found() -> None:
    """Else the test above would pass with nothing in it."""
    assert len(EXAMPLES) >= 30
