"""What every model keeps where, and what it refuses at its edge, in one line."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import torch
from torch import Tensor, nn

import ndtorch
from ndtorch.errors import InputError

NAMES = ("published", "scale-free", "retinotopic")


def held(thing: Any, place: str, seen: dict[int, Any]) -> Iterator[tuple[str, Tensor]]:
    """Every tensor that can be reached from a thing, however it is kept there, and where."""
    if id(thing) in seen:
        return
    seen[id(thing)] = thing
    if isinstance(thing, Tensor):
        yield place, thing
        return
    parts: dict[Any, Any] = {}
    if isinstance(thing, dict):
        parts = thing
    elif isinstance(thing, tuple | list | set | frozenset):
        parts = dict(enumerate(thing))
    elif not isinstance(thing, type):
        closure = getattr(thing, "__closure__", None) or ()
        parts = {**getattr(thing, "__dict__", {}), **{n: cell.cell_contents for n, cell in enumerate(closure)}}
    for name, part in parts.items():
        yield from held(part, f"{place}.{name}", seen)


@pytest.mark.parametrize("name", NAMES)
def test_all_fixed_tensors_are_buffers(name: str) -> None:
    """Also those that a forward has made and kept: none of them is left behind where a model moves."""
    model = ndtorch.load(name, size=32)
    model(torch.rand(30, 3, 32, 32, generator=torch.Generator().manual_seed(0)))
    known = {id(tensor) for tensor in model.buffers()}
    assert [place for place, tensor in held(model, name, {}) if id(tensor) not in known] == []
    assert len(known) > 3
    assert {tensor.device.type for tensor in model.to("meta").buffers()} == {"meta"}


@pytest.mark.parametrize("name", NAMES)
def test_floats_of_0_to_255_are_refused(name: str) -> None:
    model = ndtorch.load(name, size=32)
    frames = 255 * torch.rand(4, 3, 32, 32, generator=torch.Generator().manual_seed(0))
    with pytest.raises(InputError, match=r"frames of floats must lie in 0\.\.1, got .*divide by 255"):
        model(frames)
    model(frames.to(torch.uint8))


@pytest.mark.parametrize("name", NAMES)
def test_other_types_than_single_and_double_are_refused_through_every_door(name: str) -> None:
    model = ndtorch.load(name, size=32)
    around, half = nn.Sequential(model), torch.zeros(1).half()
    for convert in (
        *(model.half, model.bfloat16, around.half, around.bfloat16),
        *(lambda: model.to(torch.float16), lambda: model.to(dtype=torch.bfloat16), lambda: model.to(half)),
        *(lambda: model.type(torch.float16), lambda: around.type(torch.int32), lambda: around.type(torch.complex64)),
    ):
        with pytest.raises(InputError, match="computes in single or double precision"):
            convert()
    assert model.double().float().dtype == torch.float32


@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("name", [*NAMES, "foreground"])
def test_a_picture_gives_the_same_numbers_in_every_type(name: str, double: bool) -> None:
    quick = {} if name in ("foreground", "retinotopic") else {"settle": 0.0}
    model = ndtorch.load(name, size=48, fps=30, **quick)
    model = model.double() if double else model
    drawn = torch.randint(0, 256, (24, 3, 48, 48), generator=torch.Generator().manual_seed(0)).to(torch.uint8)
    wanted, after = model(drawn)
    for frames in (drawn.double() / 255, drawn.float() / 255):
        given, end = model(frames)
        assert torch.equal(given.outputs, wanted.outputs)
        assert torch.equal(model.weights(end), model.weights(after))
    finer = torch.rand(4, 3, 48, 48, generator=torch.Generator().manual_seed(1), dtype=torch.float32)
    assert torch.equal(model(finer)[0].outputs, model(finer.double())[0].outputs)
    for other in (torch.float16, torch.bfloat16, torch.int64, torch.bool):
        with pytest.raises(InputError, match="frames must be float32 or float64"):
            model(drawn.to(other))
