"""Which pixels the kernels of navigation take, and where a subfield may lie."""

from __future__ import annotations

import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import StereoRig
from ndtorch.navigation.controllers.subfields import SubfieldMotion
from ndtorch.navigation.rig import Rect
from ndtorch.navigation.strip_kernels import eyes as pixels_of
from tests.navigation.test_kernels import pairs

pytest.importorskip("numba")

RECTS = Rect(30, 50, 10, 70), Rect(30, 50, 250, 310)


def test_which_pixels_kernels_take() -> None:
    left, right = (eye[:1] for eye in pairs(torch.uint8))
    with torch.inference_mode():
        whole = pixels_of(left, right, RECTS, (240, 320))
        assert whole is not None
        assert (whole.tops, whole.lefts, whole.beside) == ((30, 30), (10, 250), False)
        assert (whole.unit, whole.over) == (1 / 765, 1)
        assert all((seen == eye[0].numpy()).all() for seen, eye in zip(whole.frames, (left, right), strict=True))
        cut = [eye[..., r.top : r.bottom, r.left : r.right] for eye, r in zip((left, right), RECTS, strict=True)]
        strips = pixels_of(*cut, RECTS, (240, 320))
        assert strips is not None
        assert (strips.tops, strips.lefts) == ((0, 0), (0, 0))
        grey = pixels_of(left[:, :1].double(), right[:, :1].double(), RECTS, (240, 320))
        assert grey is not None
        assert (grey.unit, grey.over) == (1.0, 1)
        beside = [eye.contiguous(memory_format=torch.channels_last) for eye in (left, right)]
        colors = pixels_of(*beside, RECTS, (240, 320))
        assert colors is not None
        assert colors.beside
        for others in (
            (left.numpy(), right.numpy()),
            (left, right.numpy()),
            (left[0], right[0]),
            (left.repeat(2, 1, 1, 1), right.repeat(2, 1, 1, 1)),
            (left, right[..., :-1]),
            (left, right.float()),
            (left[:, :2], right[:, :2]),
            (left.half(), right.half()),
            (left[..., :-1], right[..., :-1]),
            (left, beside[1]),
        ):
            assert pixels_of(*others, RECTS, (240, 320)) is None  # type: ignore[arg-type]
    assert pixels_of(left, right, RECTS, (240, 320)) is None  # gradients are torch's


@pytest.mark.parametrize(("side", "place"), [("top", -1), ("bottom", 481), ("left", -1), ("right", 641)])
def test_a_subfield_may_reach_the_border_and_not_beyond(side, place):
    whole = Rect(0, 480, 0, 640)
    assert SubfieldMotion(StereoRig(), 1 / 30, (whole, whole)).fields == (whole, whole)
    beyond = whole._replace(**{side: place})
    with pytest.raises(InputError, match="inside"):
        SubfieldMotion(StereoRig(), 1 / 30, (beyond, beyond))
