"""What is torch gives on a CUDA device the numbers it gives on the CPU."""

import pytest
import torch

import ndtorch
from ndtorch.arguments import set_backend
from ndtorch.binding import InhibitoryNetwork, load_state, save_state, to_device
from ndtorch.errors import InputError
from ndtorch.scenes import RED, Bar, BarScene, Distance, RandomShadow, SineShadow
from ndtorch.vision import (
    HassensteinReichardt,
    LocalFeatures,
    NDMin,
    NDMinus,
    OrientedDoG,
    Resample,
    VisualFeatures,
)
from tests.navigation.test_navigator import frames, full_navigator, leaves

pytestmark = [
    pytest.mark.cuda,
    pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device"),
]
DEVICE = "cuda"


def noise(*shape: int) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(0))


def assert_same(here: object, there: object, tolerance: float = 1e-4) -> None:
    pairs = list(zip(leaves(here), leaves(there), strict=True))
    assert any(b.device.type == DEVICE for _, b in pairs)
    for a, b in pairs:
        torch.testing.assert_close(b.cpu(), a.cpu(), atol=tolerance, rtol=tolerance)


MODULES = {
    "features": VisualFeatures((48, 64)),
    "features, exact": VisualFeatures((48, 64), exact=True),
    "features in fields": LocalFeatures(VisualFeatures((48, 64)), fields=4),
    "oriented DoG": OrientedDoG((48, 64)),
    "HR": HassensteinReichardt(),
    "ND-min": NDMin(),
    "ND-minus": NDMinus(),
    "resample": Resample(0.04, 0.01),
}


@pytest.mark.parametrize("name", MODULES)
def test_vision(name: str) -> None:
    module = MODULES[name]
    given = noise(12, 3, 48, 64)
    set_backend(module, "torch")
    here = module(given)
    assert_same(here, module.to(DEVICE)(given.to(DEVICE)))


@pytest.mark.parametrize("rule", ["competitive", "cooperative", "hebbian", "scale-free"])
def test_networks_learn(rule: str) -> None:
    signals = noise(3, 600, 10)
    network = InhibitoryNetwork(rule=rule, settle=0.0, backend="torch").double()
    here = network(signals.double())
    assert_same(here, network.to(DEVICE)(signals.double().to(DEVICE)), 1e-6)


@pytest.mark.parametrize("name", ["published", "scale-free", "retinotopic"])
def test_models(name: str, tmp_path) -> None:
    """Also a state that was saved on one device and goes on on the other. Sums, since the motion of a second frame is
    rounding alone, which the normalization raises to one."""
    local, model = name == "retinotopic", ndtorch.load(name, size=64, backend="torch").double()
    film = noise(100, 3, 64, 64).double() if local else 100 * noise(600, 10).double()
    moved = ndtorch.load(name, size=64, backend="torch").double().to(DEVICE)
    here, there = (one if local else one.from_sums for one in (model, moved))
    found, state = here(film)
    found_there, state_there = there(film.to(DEVICE))
    assert_same((found.outputs, model.weights(state)), (found_there.outputs, moved.weights(state_there)), 1e-5)
    assert len(moved.objects(state_there)) == len(model.objects(state))
    save_state(state_there, tmp_path / "state")
    back, _ = load_state(tmp_path / "state", model)
    assert_same(here(film[:10], back)[0].outputs, there(film[:10].to(DEVICE), state_there)[0].outputs, 1e-5)
    again, _ = there(film[:10].to(DEVICE), to_device(back, DEVICE))
    assert again.outputs.device.type == DEVICE


def test_gradients() -> None:
    features = VisualFeatures((48, 64), backend="torch")
    grads = []
    for device in ("cpu", DEVICE):
        given = noise(4, 3, 48, 64).to(device).requires_grad_()
        features.to(device)(given)[0].square().mean().backward()
        grads.append(given.grad)
    assert_same(*grads)


@pytest.mark.parametrize("kind", [SineShadow(), RandomShadow(5), Distance(phase=[0, 70])])
def test_scenes(kind) -> None:
    bars = [Bar(RED, -30, (20, 30)), Bar((0, 1, 0), 210, (70, 50))]
    here, there = (BarScene(bars, 1, kind, (80, 90), device=d).frames(0, 20) for d in ("cpu", DEVICE))
    assert_same(here, there, 1e-5)


def test_navigation() -> None:
    left, right = frames(3, 5, steps=12)
    navigator = full_navigator()
    here = leaves(navigator(left, right))
    assert_same(here, navigator.to(DEVICE)(left.to(DEVICE), right.to(DEVICE)))


def test_controllers_with_kernels_only_refuse_other_devices() -> None:
    left, right = (eye.to(DEVICE) for eye in frames(3, steps=2))
    with pytest.raises(InputError, match="CPU"):
        full_navigator("ranging", "auto")(left, right)


def test_foreground_copies_frames_to_the_cpu() -> None:
    film = (255 * frames(3, steps=6)[0]).to(torch.uint8)
    here, there = (ndtorch.load("foreground", size=(240, 320), fps=30.0)(film.to(d))[0] for d in ("cpu", DEVICE))
    assert torch.equal(here.outputs, there.outputs.cpu())
    assert torch.equal(here.inputs, there.inputs.cpu())
