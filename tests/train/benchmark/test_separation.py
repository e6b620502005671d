"""Random mixtures, and what separates sources in them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from ndtorch.binding import ObjectFiles
from ndtorch.errors import InputError
from ndtorch.vision import VisualFeatures
from ndtorch_train.benchmark import retinotopic as local
from ndtorch_train.benchmark.bar_scenes import (
    DIRECTIONS,
    FPS,
    ORIENTATIONS,
    SIZE,
    SPEED,
    Restriction,
    Scene,
    draw_scene,
    first_stage,
    superposed,
    true_features,
)
from ndtorch_train.benchmark.hard_scenes import HARD, arrived
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


def hill(width: float = 30.0) -> Tensor:
    """What a field sees of a bar falls off with the distance alone, `[DIRECTIONS, ORIENTATIONS, 8, POINTS, POINTS]`."""
    away = (torch.arange(local.POINTS) * local.STEP + local.CANVAS / 2) % local.CANVAS - local.CANVAS / 2
    line = torch.exp(-((away / width) ** 2))
    return (line[:, None] * line).expand(DIRECTIONS, ORIENTATIONS, 8, -1, -1)


def sums(scene: Scene, table: Tensor, seconds: float = 1.0, chunk: int = 20) -> Tensor:
    return torch.cat(list(local.local_sums([scene], seconds, table, chunk)), 1)[0]


def test_a_bar_is_felt_where_it_is_and_not_beyond_half_the_canvas() -> None:
    scene = draw_scene(3, Restriction(1))
    bar = replace(scene.bars[0], direction=0, start=(240.0, 100.0))
    seen = sums(Scene(3, (bar,)), hill())[..., 4:7].sum(-1)
    for step, second in ((0, 0.0), (19, 0.95)):
        row, column = divmod(int(seen[step].argmax()), local.FIELDS)
        assert row == round(100.5 / local.SPACING - 0.5)
        assert abs(column - ((240.5 + SPEED * second) / local.SPACING - 0.5)) <= 0.6
    away = [abs((n + 0.5) * local.SPACING - 100.5) for n in range(local.FIELDS)]
    far = [n for n, rows in enumerate(away) if min(rows, SIZE[0] - rows) > local.CANVAS / 2]
    assert far
    assert not seen[:, far].any()


def test_bars_add_up_and_chunks_change_nothing() -> None:
    scene = draw_scene(4, Restriction(3))
    table = hill()
    whole = sums(scene, table)
    alone = [sums(Scene(4, (bar,)), table) for bar in scene.bars]
    torch.testing.assert_close(whole, torch.stack(alone).sum(0))
    assert torch.equal(sums(scene, table, chunk=3), whole)


@pytest.mark.slow
def test_an_upright_bar_that_goes_right_is_seen_where_it_is() -> None:
    with torch.inference_mode():
        seen = local.measure_field(0, 0, VisualFeatures((local.CANVAS, local.CANVAS)))
    left, right, down, up, upright, *others, area = seen
    assert divmod(int(area.argmax()), local.POINTS) == (0, 0)
    assert float(right.sum()) > 2 * max(float(other.sum()) for other in (left, up, down))
    assert float(upright.sum()) > 1.3 * max(float(other.sum()) for other in others)
    away = (torch.arange(local.POINTS) * local.STEP + local.CANVAS / 2) % local.CANVAS - local.CANVAS / 2
    beyond = (away[:, None] ** 2 + away**2).sqrt() > 110
    assert float(area[beyond].max()) == pytest.approx(0, abs=1e-3 * float(area.max()))


def test_objects_are_read_after_the_samples_that_were_asked_for() -> None:
    """Two things a few fields apart: one goes right, upright and red; one up, lying and green."""
    t = torch.arange(140)
    signals = torch.zeros(1, len(t), local.FIELDS, local.FIELDS, 10)
    for (row, column), features, period in (((4, 4), (0, 4, 7), 17), ((11, 10), (1, 5, 8), 23)):
        light = 20 * (1.5 + torch.sin(t * 2 * torch.pi / period))
        for feature in features:
            signals[0, :, row, column, feature] = light
    files = ObjectFiles((local.FIELDS, local.FIELDS), local.SPACING, local.EVERY / FPS)
    with torch.inference_mode():
        readings = local.found(files, iter(signals.split(16, 1)), [1, 140])
    assert len(readings) == 2
    early, late = (reading[0] for reading in readings)
    assert len(early) == 0
    assert late.shape == (2, 10)


SETS = {hard.name: hard for hard in HARD}


def test_every_sample_of_the_fields_is_seen_once() -> None:
    """They were repeated five times, so that all went at a fifth of its speed."""
    kept = arrived(SETS["white 0.3"], [1], 100, 5)[0]
    assert (kept // 5).tolist() == list(range(20))
    lossy = SETS["12.5/s, 10 % lost"]
    late = arrived(lossy, [1], 8000, lossy.every)[0]
    assert len(late) == 1000
    assert 0.02 < (late[1:] == late[:-1]).double().mean() < 0.25


TEXTURED = local.RENDERED[0]


def test_a_ground_shows_where_no_bar_is_and_stays() -> None:
    scene = draw_scene(local.RENDERED_SEED, Restriction(1))
    first, last = local.OnGround(scene, TEXTURED).frames(0, 40)[[0, -1]]
    same = (first == last).all(0)
    assert 0.98 < same.double().mean() < 1
    assert torch.equal(first[:, same], local.ground(scene.seed)[:, same])


@pytest.mark.slow
def test_a_ground_without_bars_is_nothing() -> None:
    empty = local.OnGround(Scene(3, ()), TEXTURED, seconds=0.6)
    assert local.seen_in(empty).shape == (0, 10)
