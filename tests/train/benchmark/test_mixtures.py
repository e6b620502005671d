"""Blind separation of random mixtures: sources, mixtures and the score."""

from pathlib import Path

import numpy as np
import pytest

from ndtorch.errors import InputError
from ndtorch_train.benchmark.mixtures import draw_mixing, draw_sources, mixture_benchmark, sinr

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
