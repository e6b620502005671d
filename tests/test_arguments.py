"""Every public part against every kind of input that it cannot use: one `InputError` that names the argument."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import Tensor

from ndtorch import binding, navigation, vision
from ndtorch.binding.models.published import PublishedConfig, PublishedModel
from ndtorch.errors import InputError
from ndtorch.vision.features import VisualFeatures

SIZE = (16, 20)
RIG = navigation.StereoRig(width=64, height=48, focal=43.0)
DT = 1 / 30
RIGHT = object()


def frames(steps: int = 2, size: tuple[int, int] = SIZE) -> Tensor:
    """Floating point frames `[T, 3, H, W]`, of which every pixel differs."""
    return torch.linspace(0.1, 0.9, steps * 3 * size[0] * size[1]).view(steps, 3, *size)


def signals(*shape: int) -> Tensor:
    return torch.linspace(0.1, 0.9, int(torch.tensor(shape).prod())).view(shape)


def weights(n: int = 10) -> Tensor:
    return torch.full((n, n), 0.02).fill_diagonal_(0.0)


def ranges(x: Any = RIGHT) -> navigation.Ranges:
    blank = torch.full((2, 5), 0.1)
    return navigation.Ranges(blank, blank, blank - 0.2, blank + 1 if x is RIGHT else x, blank, blank > 0)


def pose(x: Any = RIGHT) -> navigation.Pose:
    still = torch.zeros(2)
    return navigation.Pose(still if x is RIGHT else x, still, still)


def eyes() -> Tensor:
    return frames(1, (RIG.height, RIG.width))


def steer(**given: Any) -> Any:
    rest = {"left": eyes(), "right": eyes(), **given}
    return navigator()(**rest)


def navigator() -> navigation.Navigator:
    return navigation.Navigator(RIG, DT, controller="published")


def attend(**given: Any) -> Any:
    table = binding.object_table(weights())
    rest = {"frames": frames(), "images": signals(2, 10, *SIZE), "outputs": signals(2, 10), "scale": signals(2, 10)}
    return binding.Attention(DT)(**{**rest, **given}, table=table)


def still() -> Tensor:
    return torch.zeros(1)


def model() -> PublishedModel:
    return PublishedModel(PublishedConfig(size=SIZE, fps=100.0))


Case = tuple[str, Callable[[Any], Any], Callable[[], Tensor]]
# What the message may call the argument, how it is given, and one that is right.
VISION: dict[str, Case] = {
    "LowPass": ("x", vision.LowPass(0.1, DT), frames),
    "HighPass": ("x", vision.HighPass(0.1, DT), frames),
    "RunningMax": ("x", vision.RunningMax(0.2, DT), lambda: signals(4, 10)),
    "NDMin": ("x", vision.NDMin(), frames),
    "NDMinus": ("x", vision.NDMinus(), frames),
    "NDS": ("x", vision.NDS(), frames),
    "ChahlSrinivasan": ("x", vision.ChahlSrinivasan(), frames),
    "Resample": ("x", vision.Resample(DT, 0.01), lambda: signals(4, 10)),
    "Resample same": ("x", vision.Resample(DT, DT), lambda: signals(4, 10)),
    "HassensteinReichardt": ("frames", vision.HassensteinReichardt(), frames),
    "VisualFeatures": ("frames", vision.VisualFeatures(SIZE), frames),
    "LocalFeatures": ("frames", vision.LocalFeatures(VisualFeatures(SIZE), 4), frames),
    "OrientedDoG": ("frames", vision.OrientedDoG(SIZE), frames),
    "row_shift earlier": ("earlier", lambda x: vision.row_shift(x, frames()), frames),
    "row_shift later": ("later", lambda x: vision.row_shift(frames(), x), frames),
    "field_weights": ("points", lambda x: vision.field_weights(x, 16, 4), lambda: signals(16)),
    "judge_speed_curve speeds": ("speeds", lambda x: vision.judge_speed_curve(x, signals(5)), lambda: signals(5)),
    "judge_speed_curve responses": ("responses", lambda x: vision.judge_speed_curve(signals(5), x), lambda: signals(5)),
}
BINDING: dict[str, Case] = {
    "InhibitoryNetwork": ("inputs", binding.InhibitoryNetwork(), lambda: signals(4, 10)),
    "InhibitoryNetwork of fields": ("inputs", binding.InhibitoryNetwork(shared=True), lambda: signals(4, 3, 10)),
    "InhibitoryNetwork initial": ("initial", lambda x: binding.InhibitoryNetwork(initial=x), weights),
    "BindingInputs": ("sums", binding.BindingInputs(), lambda: signals(4, 10)),
    "ObjectFiles": ("signals", binding.ObjectFiles((4, 4), 4.0), lambda: signals(2, 4, 4, 10)),
    "PublishedModel": ("frames", model(), frames),
    "PublishedModel.from_sums": ("sums", model().from_sums, lambda: signals(4, 10)),
    "object_table": ("weights", binding.object_table, weights),
    "spectral_radius": ("weights", binding.spectral_radius, weights),
    "solutions": ("mixing", binding.solutions, lambda: torch.eye(4)[:, :2] + 0.1),
    "separated mixing": ("mixing", lambda x: binding.separated(x, weights(4)), lambda: torch.eye(4)[:, :2] + 0.1),
    "separated weights": ("weights", lambda x: binding.separated(torch.eye(4), x), lambda: weights(4)),
    "Attention frames": ("frames", lambda x: attend(frames=x), frames),
    "Attention images": ("images", lambda x: attend(images=x), lambda: signals(2, 10, *SIZE)),
    "Attention outputs": ("outputs", lambda x: attend(outputs=x), lambda: signals(2, 10)),
    "Attention scale": ("scale", lambda x: attend(scale=x), lambda: signals(2, 10)),
}
NAVIGATION: dict[str, Case] = {
    "Navigator left": ("left|frames", lambda x: steer(left=x), eyes),
    "Navigator right": ("right|frames", lambda x: steer(right=x), eyes),
    "Navigator speed": ("driven.speed", lambda x: steer(driven=navigation.Command(x, still())), still),
    "Navigator curvature": ("driven.curvature", lambda x: steer(driven=navigation.Command(still(), x)), still),
    "StereoRanging left": ("left|frames", lambda x: navigation.StereoRanging(RIG, DT)(x, eyes()), eyes),
    "StereoRanging right": ("right|frames", lambda x: navigation.StereoRanging(RIG, DT)(eyes(), x), eyes),
    "DeadReckoning speed": ("speed", lambda x: navigation.DeadReckoning(DT)(x, torch.zeros(2)), lambda: signals(2)),
    "DeadReckoning bend": ("curvature", lambda x: navigation.DeadReckoning(DT)(torch.zeros(2), x), lambda: signals(2)),
}
MAPS: dict[str, Callable[[], Any]] = {
    "GridMap": lambda: navigation.GridMap(RIG, navigation.Grid(cell=0.5)),
    "ObservationList": lambda: navigation.ObservationList(DT),
    "AlphaBetaTracker": lambda: navigation.AlphaBetaTracker(DT),
}
for _name, _make in MAPS.items():
    NAVIGATION[f"{_name} ranges"] = ("ranges.x", lambda x, make=_make: make()(ranges(x), pose()), lambda: ranges().x)
    NAVIGATION[f"{_name} pose"] = ("pose.x", lambda x, make=_make: make()(ranges(), pose(x)), lambda: torch.zeros(2))
ALLOWED = {("InhibitoryNetwork initial", "None"), ("solutions", "int64"), ("solutions", "bool")}
"""What some of them can use."""
PARTS = {**VISION, **BINDING, **NAVIGATION}


def spoiled(value: float) -> Callable[[Tensor], Tensor]:
    def spoil(x: Tensor) -> Tensor:
        x = x.clone()
        x.view(-1)[x.numel() // 2] = value
        return x

    return spoil


def whole_numbers(x: Tensor) -> Tensor:
    return x.round().to(torch.int64)


BAD: dict[str, Callable[[Tensor], Any]] = {
    "int64": whole_numbers,
    "bool": lambda x: x > 0.5,
    "half": lambda x: x.half(),
    "complex": lambda x: x.to(torch.complex64),
    "sparse": lambda x: x.to_sparse(),
    "meta": lambda x: x.to("meta"),
    "list": lambda x: x.tolist(),
    "numpy": lambda x: x.numpy(),
    "None": lambda x: None,
    "text": lambda x: "frames",
    "scalar": lambda x: x.reshape(-1)[0],
    "NaN": spoiled(float("nan")),
    "inf": spoiled(float("inf")),
}


def outcome(part: str, kind: str) -> str:
    """What came of one bad argument: "" where it was refused by name, where half precision gave finite numbers, or
    where shapes alone came of shapes alone."""
    name, give, good = PARTS[part]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            out = give(BAD[kind](good()))
    except InputError as error:
        return "" if any(one in str(error) for one in name.split("|")) else f"not named: {error}"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    if kind == "meta" and any(x.is_meta for x in numbers(out)):
        return ""
    if kind == "half":
        return "" if all(map(finite, numbers(out))) else "silent NaN"
    return "taken"


def numbers(out: Any) -> list[Tensor]:
    """All tensors of a nest of tuples."""
    if isinstance(out, Tensor):
        return [out]
    return [part for each in out for part in numbers(each)] if isinstance(out, tuple | list) else []


def finite(x: Tensor) -> bool:
    return bool(torch.isfinite(x).all())


@pytest.mark.parametrize("part", PARTS)
def test_what_cannot_be_used_is_refused_by_name(part: str) -> None:
    _, give, good = PARTS[part]
    give(good())
    bad = {kind: found for kind in BAD if (part, kind) not in ALLOWED and (found := outcome(part, kind))}
    assert not bad


@pytest.mark.parametrize("quick", [True, False], ids=["inference", "grad"])
def test_one_nan_is_refused_and_leaves_no_trace(quick: bool) -> None:
    look = navigator()
    good, bad = eyes(), eyes()
    bad[..., look.ranging.rig.row, 3] = float("nan")
    with torch.inference_mode(quick):
        _, state = look(good, good)
        expected, _ = look(good, good, state)
        with pytest.raises(InputError, match="finite"):
            look(bad, good, state)
        for part in ("speed", "curvature"):
            driven = navigation.Command(still(), still())._replace(**{part: still() + float("nan")})
            with pytest.raises(InputError, match=rf"driven\.{part} must be finite"):
                look(good, good, state, driven)
        start = navigation.Pose(still()[0], still()[0], still()[0] + float("inf"))
        with pytest.raises(InputError, match=r"start\.heading must be finite"):
            look(good, good, start=start)
        after, then = look(good, good, state)
    assert torch.equal(after.speed, expected.speed)
    assert all(map(finite, numbers(tuple(then.pose))))
