"""What others use to separate sources."""

from __future__ import annotations

import pytest
import torch

from ndtorch_train.benchmark.bar_scenes import FPS, Restriction, draw_scene, first_stage, superposed, true_features
from ndtorch_train.benchmark.scene_scores import feature_f1
from ndtorch_train.benchmark.separation import METHODS, MmIca, Offline, Picard, Sobi


@pytest.mark.parametrize("kind", [Picard, Sobi])
def test_offline_separations_find_the_mixing(kind: type[Offline]) -> None:
    if kind is Picard:
        pytest.importorskip("picard")
    time = torch.arange(0, 20, 0.05)
    sources = torch.stack([(2.1 * time).sin().sign(), (5.3 * time).sin()], -1)
    mixing = torch.zeros(2, 10)
    mixing[0, :3], mixing[1, 2:6] = torch.tensor([1.0, 0.5, 0.2]), torch.tensor([0.3, 0.6, 1.0, 0.8])
    found = kind().separate(sources @ mixing)
    cosine = torch.nn.functional.cosine_similarity(found[:, None], mixing, dim=-1)
    assert cosine.amax(0).min() > 0.98


@pytest.mark.parametrize("name", ["mm-ica", "easi", "scale-free"])
def test_online_separations_see_two_bars(name: str) -> None:
    scene = draw_scene(4, Restriction(bars=2))
    truth = true_features([scene], first_stage())
    [reading] = METHODS[name](truth)(superposed([scene], 14.0), FPS, [14.0])
    assert len(reading.found[0]) == 2
    assert feature_f1(reading.found[0], truth[0]).mean() > 0.6


def test_mm_ica_makes_super_gaussian_sources_independent() -> None:
    torch.manual_seed(0)
    sources = torch.distributions.Laplace(0.0, 0.7).sample((3000, 2)).double()
    mixing = torch.tensor([[1.0, 0.6], [-0.4, 1.0]], dtype=torch.float64)
    learned, unmixing = MmIca(), torch.eye(2, dtype=torch.float64).numpy()
    learned.start(2)
    for sample in (sources @ mixing.mT).numpy():
        unmixing = learned.learn(sample, unmixing)
    gain = torch.from_numpy(unmixing) @ mixing
    smaller = gain.abs().amin(-1) / gain.abs().amax(-1)
    assert smaller.max() < 0.15
