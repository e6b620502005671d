"""Random mixtures, and what separates sources in them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch_train.benchmark.bar_scenes import FPS, Restriction, draw_scene, first_stage, superposed, true_features
from ndtorch_train.benchmark.mixtures import draw_mixing, draw_sources, mixture_benchmark, sinr
from ndtorch_train.benchmark.scene_scores import feature_f1
from ndtorch_train.benchmark.separation import METHODS, MmIca, Offline, Picard, Sobi

RNG = np.random.default_rng(2)


def test_sources_are_uniform_and_correlated() -> None:
    sources = draw_sources(RNG, 50_000, 0.6)
    for one in sources.T:
        assert np.quantile(one, [0.1, 0.5, 0.9]) == pytest.approx([0.1, 0.5, 0.9], abs=0.02)
    # Spearman's coefficient of a t copula is close to 6 / pi asin(c / 2), that of the Gaussian one.
    expected = 6 / np.pi * np.arcsin(np.array([0.6, 0.36]) / 2)
    assert np.corrcoef(sources.T)[0, 1:3] == pytest.approx(expected, abs=0.03)


def test_every_source_leads_two_inputs() -> None:
    gains = draw_mixing(RNG, "leading")
    assert (np.sort(gains, 1)[:, :-1] <= 0.3).all()
    assert (np.bincount(gains.argmax(1)) == 2).all()


def test_sinr_is_that_of_the_noise() -> None:
    sources = RNG.standard_normal((100_000, 5))
    noisy = sources + 0.1 * RNG.standard_normal(sources.shape)
    assert sinr(noisy, sources) == pytest.approx(20, abs=0.2)
    assert sinr(-3 * noisy[:, ::-1] + 7, sources) == pytest.approx(sinr(noisy, sources))


def test_the_network_gains_where_sources_lead() -> None:
    tasks = {task.key: task.work for task in mixture_benchmark(1, 5000, "tune").tasks}
    network, alone = (tasks[f"leading, {name}"](Path())[0] for name in ("competitive network", "mixtures as they are"))
    assert network["c0"] > alone["c0"] + 2
    with pytest.raises(InputError, match="mixtures"):
        mixture_benchmark(0, 5000, "tune")


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
