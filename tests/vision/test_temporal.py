"""Temporal filters and resampling."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.signal import lfilter

from ndtorch.errors import InputError
from ndtorch.scenes import Bar, BarScene
from ndtorch.vision import (
    NDS,
    ChahlSrinivasan,
    HassensteinReichardt,
    HighPass,
    LocalFeatures,
    LowPass,
    NDMinus,
    Resample,
    ResampleState,
    RunningMax,
    VisualFeatures,
    field_weights,
    smoothing_factor,
)
from ndtorch.vision.motion import Border
from ndtorch.vision.temporal import BLOCK, low_pass, low_pass_block
from tests.strategies import chunkings, in_chunks, noise


def low_passed(x: np.ndarray, tau: float, dt: float) -> np.ndarray:
    """The same filter as a difference equation along the first axis, settled on the first sample."""
    a = dt / (tau + dt)
    return lfilter([a], [1, a - 1], x, axis=0, zi=(1 - a) * x[:1])[0]


@pytest.mark.parametrize("tau", [0.0, 0.004, 0.5, math.inf])
@pytest.mark.parametrize(("kind", "most"), [(torch.float32, 1e-6), (torch.float64, 1e-14)])
def test_a_block_is_filtered_as_frame_by_frame(tau: float, kind: torch.dtype, most: float) -> None:
    x, low = noise(2, BLOCK, 3, 5).to(kind), noise(2, 3, 5).to(kind)
    assert_allclose(
        low_pass_block(x, low, 0.01 / (tau + 0.01), 1), low_pass(x, low, tau, 0.01, 1)[0], rtol=0, atol=most
    )


def test_a_block_has_gradients() -> None:
    given = [noise(4, 2).double(), noise(2).double(), torch.tensor(0.3).double()]
    assert torch.autograd.gradcheck(lambda *x: low_pass_block(*x, 0), [one.requires_grad_() for one in given])


@pytest.mark.parametrize(
    ("module", "shape"),
    [
        (HassensteinReichardt(), (3, 8, 9)),
        (NDMinus(), (1, 1, 9)),
        (NDS(tau_low=0.05), (1, 1, 9)),
        (ChahlSrinivasan(), (1, 1, 9)),
        (VisualFeatures((16, 16), backend="torch"), (3, 16, 16)),
    ],
)
def test_an_exported_program_does_not_grow_with_time(module: torch.nn.Module, shape: tuple[int, ...]) -> None:
    programs = [torch.export.export(module, (torch.rand(frames, *shape),)) for frames in (4, BLOCK)]
    assert len(programs[0].graph.nodes) == len(programs[1].graph.nodes)
    x = torch.rand(BLOCK, *shape)
    want = module(x)[0]
    assert_allclose(programs[1].module()(x)[0], want, rtol=1e-4, atol=1e-5 * float(want.abs().max()))


@pytest.mark.parametrize("tau", [0.004, 0.5, 3.0])
def test_low_pass_is_a_first_order_recursion(tau: float) -> None:
    x = noise(40, 10)
    out, state = LowPass(tau, 0.01, sample_dims=1)(x)
    expected = low_passed(x.numpy(), tau, 0.01)
    assert_allclose(out, expected, atol=1e-13)
    assert_allclose(state.low, expected[-1], atol=1e-13)


@pytest.mark.parametrize("rate", [20, 100, 1000])
@pytest.mark.parametrize("tau", [0.05, 0.5, torch.tensor(0.05).double()])
def test_exact_filters_decay_as_the_continuous_one_at_any_rate(tau: float, rate: int) -> None:
    step = torch.ones(rate // 2 + 1, 1, dtype=torch.float64)
    step[0] = 0
    seconds = np.arange(len(step)) / rate
    low = LowPass(tau, 1 / rate, 1, "exact")(step)[0][:, 0]
    assert_allclose(low, 1 - np.exp(-seconds / float(tau)), rtol=1e-12)
    for module in (NDMinus(tau, 1 / rate, discretization="exact"), NDS(tau, 0.0, 1 / rate, discretization="exact")):
        high = module(step.view(-1, 1, 1, 1))[0].flatten()
        assert_allclose(high, (seconds > 0) * np.exp(-seconds / float(tau)) * isinstance(module, NDS), atol=1e-12)


def test_filters_at_the_ends_of_their_range() -> None:
    x, dt = noise(7, 4), 0.01
    for kind in ("euler", "exact"):
        assert torch.equal(LowPass(0.0, dt, 1, kind)(x)[0], x)  # type: ignore[arg-type]
        assert torch.equal(HighPass(math.inf, dt, 1, kind)(x)[0], x - x[:1])  # type: ignore[arg-type]
    tau = torch.tensor(-0.01, requires_grad=True)
    a = smoothing_factor(tau, dt, discretization="exact")
    assert float(a.detach()) == pytest.approx(1.0, abs=1e-4)
    assert float(torch.autograd.grad(a, tau)[0]) < 0
    with pytest.raises(InputError, match="euler or exact"):
        LowPass(0.1, dt, 1, "tustin")  # type: ignore[arg-type]


def test_kernels_filter_as_the_modules_do() -> None:
    frames = torch.rand(6, 3, 64, 64)
    sums = {
        (backend, kind): VisualFeatures((64, 64), 0.04, backend=backend, discretization=kind)(frames)[0][:, :4]
        for backend in ("numba", "torch")
        for kind in ("euler", "exact")
    }
    assert_allclose(sums["numba", "exact"], sums["torch", "exact"], rtol=1e-4, atol=1e-4)
    assert float((sums["numba", "exact"] / sums["numba", "euler"])[2:].std()) > 1e-3


def recent_max(x: np.ndarray, window: int) -> np.ndarray:
    return np.stack([x[max(0, t - window + 1) : t + 1].max(0) for t in range(len(x))])


@pytest.mark.parametrize(("seconds", "window"), [(0.0, 1), (0.01, 1), (0.05, 5), (2.0, 200)])
def test_recent_max_looks_back_over_its_window(seconds: float, window: int) -> None:
    x = noise(60, 3)
    out, state = RunningMax(seconds, 0.01)(x)
    assert_allclose(out, recent_max(x.numpy(), window))
    assert state.history.shape == (window - 1, 3)


RATES = st.one_of(st.floats(5, 240), st.sampled_from([12.5, 24, 25, 30, 29.97, 50, 60, 100, 120, 240]))


@settings(max_examples=60, deadline=None)
@given(fps=RATES, data=st.data())
def test_any_chunks_at_any_rate_interpolate(fps: float, data: st.DataObject) -> None:
    lengths = data.draw(chunkings(40))
    x = noise(40, 2)
    out, state = in_chunks(Resample(1 / fps, 0.01), x, lengths, -2)
    count = math.floor(39 / fps / 0.01 + 1e-6) + 1
    assert out.shape == (count, 2)
    assert (int(state.taken), int(state.given)) == (40, count if fps != 100 else 40)
    times, frames = np.arange(count) * 0.01, np.arange(40) / fps
    for column, expected in zip(out.T, x.T, strict=True):
        assert_allclose(column, np.interp(times, frames, expected), atol=1e-9)


@pytest.mark.parametrize("fps", [12.5, 25, 29.97, 30, 60, 120, 240])
def test_counts_and_places_stay_exact_after_an_hour(fps: float) -> None:
    taken = round(3600 * fps) + 1
    given = math.floor((taken - 1) / fps * 100 + 1e-6) + 1
    ramp = (taken + torch.arange(50, dtype=torch.float64)) / fps
    last = torch.tensor([(taken - 1) / fps], dtype=torch.float64)
    state = ResampleState(last, torch.tensor(taken), torch.tensor(given))
    out, end = Resample(1 / fps, 0.01)(ramp[:, None], state)
    expected = np.arange(given, math.floor((taken + 49) / fps * 100 + 1e-6) + 1) * 0.01
    assert int(end.given) == given + len(out)
    assert_allclose(out[:, 0], expected, atol=1e-8)


@pytest.mark.parametrize(("size", "border"), [((500, 500), "wrap"), ((90, 120), "wrap"), ((432, 600), "reflect")])
def test_the_fields_together_see_what_the_wide_field_sees(size: tuple[int, int], border: Border) -> None:
    frames = torch.nn.functional.avg_pool2d(torch.rand(5, 3, *size), 7, 1, 3)
    wide = VisualFeatures(size, border=border)
    local = LocalFeatures(wide, 9)
    expected, _ = wide(frames)
    signals, _ = local(frames)
    assert signals.shape == (5, *local.grid, 10)
    assert float(((signals.sum((1, 2)) - expected).abs() / expected.amax(0)).max()) < 1e-3


def test_every_field_agrees_with_the_feature_images() -> None:
    wide = VisualFeatures((400, 400))
    local = LocalFeatures(wide, 12)
    frames = BarScene([Bar((0.8, 0.2, 0.1), 30.0, (120.0, 210.0))], 0.1, size=(400, 400)).frames(0, 10)
    images, _ = wide.images(frames)
    signals, _ = local(frames)
    rows = field_weights(torch.arange(400) + 0.5, 400, 12)
    expected = torch.einsum("rh,fhw,cw->rcf", rows, images[-1], rows)
    error = (signals[-1] - expected).abs().amax((0, 1)) / expected.amax((0, 1)).clamp_min(1e-3)
    assert float(error.max()) < 0.03


@pytest.mark.parametrize("border", ["wrap", "reflect"])
@pytest.mark.parametrize(("length", "fields"), [(500, 16), (120, 7), (33, 5), (40, 1)])
def test_windows_add_up_to_one_everywhere(border: Border, length: int, fields: int) -> None:
    weights = field_weights(torch.arange(length, dtype=torch.float64) + 0.5, length, fields, border)
    assert weights.shape == (fields, length)
    assert float((weights.sum(0) - 1).abs().max()) < 1e-12
    assert float(weights.min()) >= 0
