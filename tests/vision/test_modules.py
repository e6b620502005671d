"""The modules of `ndtorch.vision` as PyTorch users use modules: in a row, traced, transformed, learned, exported."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from torch import Tensor, nn
from torch._subclasses.fake_tensor import FakeTensorMode

from ndtorch.errors import InputError
from ndtorch.vision import (
    NDS,
    BarlowLevick,
    ChahlSrinivasan,
    HassensteinReichardt,
    HighPass,
    LocalFeatures,
    LoomingDetector,
    LowPass,
    NDMin,
    NDMinus,
    OrientedDoG,
    Resample,
    RunningMax,
    Sequential,
    SmallTargetDetector,
    VisualFeatures,
    frames,
)
from ndtorch.vision.nondirectional import judge_speed_curve, speed_response
from ndtorch_train.reproduce.sensors import flickering_rows

SIZE = (24, 30)


def noise(*shape: int, seed: int = 0) -> Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed))


FILM, ROWS, SIGNALS = noise(5, 3, *SIZE), noise(5, 1, 4, 12), noise(5, 4)
MODULES: dict[str, tuple[Callable[[], nn.Module], Tensor]] = {
    "NDMin": (NDMin, ROWS),
    "NDMinus": (NDMinus, ROWS),
    "NDS": (NDS, ROWS),
    "LowPass": (lambda: LowPass(0.1, 0.05), ROWS),
    "HighPass": (lambda: HighPass(0.1, 0.05), ROWS),
    "RunningMax": (lambda: RunningMax(0.2, 0.05), SIGNALS),
    "Resample": (lambda: Resample(0.02, 0.05), SIGNALS),
    "ChahlSrinivasan": (ChahlSrinivasan, ROWS),
    "HassensteinReichardt": (HassensteinReichardt, FILM),
    "BarlowLevick": (BarlowLevick, FILM),
    "SmallTargetDetector": (SmallTargetDetector, FILM),
    "LoomingDetector": (lambda: LoomingDetector(SIZE), FILM),
    "OrientedDoG": (lambda: OrientedDoG(SIZE), FILM),
    "VisualFeatures": (lambda: VisualFeatures(SIZE), FILM),
    "LocalFeatures": (lambda: LocalFeatures(VisualFeatures(SIZE), 4), FILM),
}
each = pytest.mark.parametrize("name", MODULES)


def output(module: nn.Module, x: Tensor) -> Tensor:
    out = module(x)
    return out[0] if isinstance(out, tuple) else out


@each
def test_vmap_is_a_loop(name: str) -> None:
    make, x = MODULES[name]
    module, batch = make(), torch.stack([x, x.flip(0), 1 - x])
    mapped = torch.vmap(lambda one: output(module, one))(batch)
    torch.testing.assert_close(mapped, torch.stack([output(module, one) for one in batch]))


@each
def test_large_trials_one_after_the_other_have_the_same_gradient(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    make, x = MODULES[name]
    batch = torch.stack([x, x.flip(0), 1 - x]).requires_grad_()
    found = []
    for large in (1 << 18, 1):
        monkeypatch.setattr(frames, "LARGE", large)
        out = output(make(), batch)
        found.append((out, *torch.autograd.grad(out.square().sum(), batch)))
    torch.testing.assert_close(*found)


@each
def test_without_numbers_shapes_come_out(name: str) -> None:
    """On the device meta, and in FakeTensorMode."""
    make, x = MODULES[name]
    expected = output(make(), x)
    out = output(make().to("meta"), x.to("meta"))
    assert out.is_meta
    assert out.shape == expected.shape
    with FakeTensorMode(allow_non_fake_inputs=True) as mode:
        fake = output(make(), mode.from_tensor(x))
    assert (fake.shape, fake.dtype) == (expected.shape, expected.dtype)


@each
def test_half_precision_comes_out_or_is_refused(name: str) -> None:
    make, x = MODULES[name]
    for kind, most in ((torch.float16, 2e-3), (torch.bfloat16, 2e-2)):
        low = x.to(kind)
        if x is FILM:
            with pytest.raises(InputError, match="frames must be float32 or float64"):
                make()(low)
        else:
            out = output(make(), low)
            assert out.dtype == kind
            torch.testing.assert_close(out.float(), output(make(), low.float()), atol=most, rtol=5 * most)


@each
def test_autocast_changes_nothing(name: str) -> None:
    make, x = MODULES[name]
    with torch.autocast("cpu", torch.bfloat16):
        out = output(make(), x)
    assert torch.equal(out, output(make(), x))


def test_weights_do_not_depend_on_the_size_of_frames() -> None:
    learned = OrientedDoG(SIZE, center=nn.Parameter(torch.tensor([5.0, 2.0])))
    other = OrientedDoG((40, 20), center=nn.Parameter(torch.tensor([9.0, 3.0])))
    other.load_state_dict(learned.state_dict())
    assert torch.equal(other.center, learned.center)  # type: ignore[arg-type]
    assert OrientedDoG(SIZE).state_dict() == {}


LEARNED: dict[str, tuple[Callable[..., nn.Module], tuple[str, ...], Tensor]] = {
    "LowPass": (lambda tau: LowPass(tau, 0.05), ("tau",), noise(4, 1, 2, 5)),
    "NDMin": (lambda tau_high, dt: NDMin(tau_high, dt), ("tau_high", "dt"), noise(4, 1, 2, 5)),
    "NDS": (lambda high, low: NDS(high, low, 0.05), ("high_pass.tau", "low_pass.tau"), noise(4, 1, 2, 5)),
    "HassensteinReichardt": (
        lambda high, low: HassensteinReichardt(0.05, high, low),
        ("tau_high", "tau_low"),
        noise(4, 1, 5, 6),
    ),
    "VisualFeatures": (
        lambda high, low: VisualFeatures((12, 14), 0.05, high, low).double(),
        ("motion.tau_high", "motion.tau_low"),
        noise(4, 3, 12, 14),
    ),
}


@pytest.mark.parametrize("name", LEARNED)
def test_time_constants_are_learned(name: str) -> None:
    """They are parameters, and their gradients are those of finite differences."""
    make, names, x = LEARNED[name]
    taus = [nn.Parameter(torch.tensor(0.11 + 0.07 * n, dtype=torch.float64)) for n in range(len(names))]
    module = make(*taus)
    assert {key for key, _ in module.named_parameters()} == set(names)

    def outputs(*values: Tensor) -> Tensor:
        return torch.func.functional_call(module, dict(zip(names, values, strict=True)), (x.double(),))[0]

    assert torch.autograd.gradcheck(outputs, tuple(taus), eps=1e-6, atol=1e-5)


def test_a_time_constant_below_zero_finds_back() -> None:
    """It filters as 0 does, and has the gradient of 0."""
    x, gradients = noise(4, 1, 2, 5), []
    for value in (0.0, -0.3):
        tau = nn.Parameter(torch.tensor(value))
        out, _ = LowPass(tau, 0.05)(x)
        assert torch.equal(out, LowPass(0.0, 0.05)(x)[0])
        out.square().sum().backward()
        gradients.append(tau.grad)
    assert torch.equal(*gradients)  # type: ignore[arg-type]
    assert gradients[0] != 0


def test_deviations_of_orientation_filters_are_learned() -> None:
    center = nn.Parameter(torch.tensor([4.0, 1.5], dtype=torch.float64))
    filters = OrientedDoG((12, 14), center=center, surround=(6.0, 3.0)).double()
    fixed = OrientedDoG((12, 14), center=(4.0, 1.5), surround=(6.0, 3.0)).double()
    x = noise(1, 1, 12, 14).double()
    torch.testing.assert_close(filters(x), fixed(x), atol=1e-6, rtol=1e-5)
    assert torch.autograd.gradcheck(lambda c: torch.func.functional_call(filters, {"center": c}, (x,)), (center,))


def test_a_sequential_hands_on_states() -> None:
    """In chunks as at once, and as by hand."""
    convolution = nn.Conv2d(4, 2, 3)
    network = Sequential(HassensteinReichardt(), convolution, LowPass(0.1, 0.05), nn.Flatten())
    at_once, _ = network(FILM)
    first, state = network(FILM[:2])
    second, _ = network(FILM[2:], state)
    torch.testing.assert_close(torch.cat([first, second]), at_once)
    motion, _ = HassensteinReichardt()(FILM)
    torch.testing.assert_close(at_once, LowPass(0.1, 0.05)(convolution(motion))[0].flatten(1))
    with pytest.raises(InputError, match="state must hold 2 parts"):
        Sequential(NDMin(), nn.ReLU())(ROWS, state)


@pytest.mark.parametrize("batch_first", [False, True])
def test_a_sequential_takes_batches_and_recurrent_networks(batch_first: bool) -> None:
    """A batch gives what its trials give, in chunks too."""
    memory = nn.LSTM(1232, 3, batch_first=batch_first)
    network = Sequential(HassensteinReichardt(), nn.Conv2d(4, 2, 3), nn.Flatten(), memory, nn.BatchNorm1d(3)).eval()
    clips = torch.stack([FILM, FILM.flip(0)])
    at_once, _ = network(clips)
    first, state = network(clips[:, :2])
    torch.testing.assert_close(torch.cat([first, network(clips[:, 2:], state)[0]], 1), at_once)
    torch.testing.assert_close(torch.stack([network(clip)[0] for clip in clips]), at_once)


def test_filters_by_real_matrices_are_those_of_ffts() -> None:
    for size, border, options in (
        (SIZE, "wrap", {}),
        ((31, 40), "reflect", {}),
        ((400, 410), "reflect", {"center": (6.0, 4.0), "surround": (9.0, 6.0)}),
    ):
        usual, real = (OrientedDoG(size, border=border, **options) for _ in range(2))  # type: ignore[arg-type]
        real.use_real_arithmetic()
        image = noise(2, *size)
        torch.testing.assert_close(real.images(image), usual.images(image), atol=2e-5, rtol=1e-4)
        torch.testing.assert_close(real.sums(image), usual.sums(image), rtol=1e-4, atol=1e-3)


def test_a_response_is_the_mean_over_time_in_any_chunks() -> None:
    rows = flickering_rows()
    whole, parts = (float(speed_response(NDMin(), rows.chunks(n), 10)[0]) for n in (200, 8))
    assert parts == pytest.approx(whole, rel=1e-5)
    with pytest.raises(InputError, match="settle=200 leaves none of the 200 frames"):
        speed_response(NDMin(), rows.chunks(), 200)


def test_judge_speed_curve_by_hand():
    speeds = torch.tensor([1.0, 2.0, 3.0, 4.0])
    curves = torch.tensor([[1.0, 2.0, 3.0, 4.0], [1.0, 1.5, 1.2, 2.0], [0.0, 0.0, 0.0, 0.0]])
    found = judge_speed_curve(speeds, curves)
    assert found.monotonic_to.tolist() == [4.0, 2.0, 0.0]
    assert found.linearity.tolist() == [1.0, 0.75, 0.0]
