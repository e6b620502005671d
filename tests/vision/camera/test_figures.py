"""Figure and ground: kernels do what their references do, and a film may begin with objects in view."""

from __future__ import annotations

import copy
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from ndtorch.vision.camera import figure_signals, figures, light_changes
from ndtorch.vision.camera.figure_signals import FieldsState, FigureSignals
from ndtorch.vision.camera.figures import Standing, ground_start, ground_step, learn
from ndtorch.vision.camera.ground import Ground, GroundParams
from ndtorch.vision.camera.light_changes import light_change
from ndtorch.vision.motion import MotionState
from tests.vision.camera.passing_scenes import SIZE, ground, passing

DT = 0.04
PARAMS = GroundParams()


def steps(frames: Any, wanted: bool, monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """What every step gives, by kernels or by NumPy."""
    for module in (figures, figure_signals, light_changes):
        monkeypatch.setattr(module, "kernels_wanted", lambda *given: wanted)
    sense, fields = FigureSignals(SIZE, DT), None
    state, kept, found = ground_start(frames[0].numpy(), PARAMS), np.zeros(SIZE, np.float32), []
    for frame in frames.numpy():
        standing = ground_step(frame, state, DT, PARAMS)
        shapes = torch.from_numpy(standing.figure.astype(np.int32) * 3)
        signals, fields = sense(torch.from_numpy(standing.picture), torch.from_numpy(standing.ground), shapes, fields)
        seen = copy.deepcopy(standing)
        learn(standing, state, kept, DT, PARAMS)
        kept = seen.figure.astype(np.float32)
        found.append((seen, state.state(), signals))
        state = Ground.of(found[-1][1])
    return found


def step(picture: Any, state: Ground, dt: float = DT) -> Standing:
    """One step, what is learned at its end too."""
    standing = ground_step(picture, state, dt, PARAMS)
    learn(standing, state, np.zeros(SIZE, np.float32), dt, PARAMS)
    return standing


def test_kernels_are_their_references(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("numba")
    generator = torch.Generator().manual_seed(2)
    frames = passing(30, 4.0, first=16)
    frames = (frames + 0.01 * torch.randn(frames.shape, generator=generator)).clamp(0, 1)
    # A shadow, and an exposure that changes.
    frames[20:, :, 80:100, 20:80] *= 0.7
    frames[24:] *= 0.9
    plain, quick = (steps(frames, wanted, monkeypatch) for wanted in (False, True))
    for (one, before, signals), (other, after, sensed) in zip(plain, quick, strict=True):
        assert np.allclose(one.picture, other.picture, atol=1e-5)
        assert np.allclose(one.noise, other.noise, atol=1e-6)
        for name in ("mean", "deviation", "restless"):
            assert torch.allclose(getattr(before, name), getattr(after, name), atol=1e-4)
        # Rounding may move a pixel at a threshold.
        assert (one.figure != other.figure).mean() < 1e-3
        assert torch.allclose(signals, sensed, atol=0.02)
    assert plain[-1][0].figure.any()
    assert float(plain[-1][2][2].max()) > 0.1


def test_another_scene_begins_anew_and_another_light_does_not() -> None:
    still = ground(1).numpy()
    state = ground_start(still, PARAMS)
    for _ in range(10):
        standing = step(still, state)

    def cut(picture: Any) -> bool:
        return ground_step(picture, copy.deepcopy(state), DT, PARAMS).cut

    assert not standing.cut
    # Darker, and through another curve; not what is nearly black.
    assert not cut(still * np.float32(0.4))
    assert not cut(np.asarray(np.clip(1.3 * still, 0, 1) ** np.float32(0.8), np.float32))
    assert cut(still * np.float32(0.1))
    assert cut(np.asarray(1.6 * ground(2).numpy() - 0.2, np.float32))


def test_what_moves_in_view_from_the_first_frame_stands_out_and_leaves_no_hole() -> None:
    frames = passing(40, 3.0, first=0)
    state, shares = ground_start(frames[0].numpy(), PARAMS), []
    for n, frame in enumerate(frames.numpy()):
        standing = step(frame, state)
        true = np.zeros(SIZE, bool)
        true[44:68, 3 * n : 3 * n + 24] = True
        shares.append((standing.figure[true].mean(), standing.figure[~true].mean()))
    # Its plain inside is still, but its edges stand out at once.
    assert min(inside for inside, _ in shares[2:]) > 0.2
    assert max(outside for _, outside in shares) < 0.03
    # Once the ground under it is known, all of it does, and the place where it began does not.
    assert shares[-1][0] > 0.8
    assert state.known[44:68, :24].all()
    assert np.abs(state.mean[:, 44:68, :20] - frames[-1][:, 44:68, :20].numpy()).max() < 0.02


def test_noise_is_no_motion_and_ground_is_known_in_the_end() -> None:
    generator = torch.Generator().manual_seed(3)
    still = passing(1, 1.0, first=9)[0]
    state = ground_start(still.numpy(), PARAMS)
    for _ in range(30):
        noisy = (still + 0.04 * torch.randn(still.shape, generator=generator)).numpy()
        standing = step(noisy, state)
    assert state.known.mean() > 0.95
    assert standing.figure.mean() < 0.01
    # What never comes to rest is ground by and by: leaves.
    flicker = still.clone()
    for n in range(250):
        flicker[:, 20:40, 20:60] = 0.3 + 0.4 * (n % 2)
        standing = step(flicker.numpy(), state)
    assert state.known.all()
    assert not standing.figure.any()


def test_a_shadow_is_255_where_it_may_be_and_0_elsewhere() -> None:
    may_be = np.zeros((24, 24), np.uint8)
    may_be[:, :12] = 1
    found = figures.shadow(np.full((24, 24), 0.5, np.float32), may_be, PARAMS)
    assert set(found[:, :12].ravel().tolist()) == {255}
    assert not found[:, 12:].any()


@pytest.mark.parametrize("options", [{}, {"speckle": 2, "broad": 0.2}, {"speckle": 5, "patch": 4}, {"penumbra": 0}])
@pytest.mark.parametrize("colored", [True, False])
@pytest.mark.parametrize("known", [1.0, 0.6])
def test_a_kernel_tidies_up_as_opencv_does(options: dict[str, Any], colored: bool, known: float) -> None:
    pytest.importorskip("numba")
    chance, params, size = np.random.default_rng(4), GroundParams(**options), (92, 121)
    light = chance.normal(0.6, 0.05, size).astype(np.float32)
    light[10:30, 20:50] = 0.5
    state = ground_start(np.stack([light] * 3), params)
    # In patches, so that something is left when specks are taken away, and of all kinds at the edges, too.
    patches = [cv2.blur(chance.random(size), (side, side)) for side in (5, 9, 15)]
    state.known[...], state.quiet[...] = patches[1] < np.quantile(patches[1], known), patches[2] - 0.4
    out, may_be = (patches[0] > 0.52).astype(np.uint8), (chance.random(size) < 0.7).astype(np.uint8)
    pale = may_be & (chance.random(size) < 0.8) if colored else None
    plain = figures.tidied(out, state, light, may_be, pale, params)
    with torch.inference_mode():
        quick = figures.tidied(out.copy(), state, light, may_be, pale, params)
    assert np.array_equal(plain[0], quick[0])
    assert np.array_equal(plain[1], quick[1])
    assert 100 < plain[0].sum() < out.sum()
    assert plain[1].any() == colored


@pytest.mark.parametrize(("size", "side", "known"), [((48, 64), 3, 1.0), ((44, 60), 3, 0.5), ((48, 64), 5, 0.9)])
def test_a_kernel_finds_the_same_still(size: tuple[int, int], side: int, known: float) -> None:
    pytest.importorskip("numba")
    chance, params = np.random.default_rng(5), GroundParams(speckle=side)
    before = chance.random((3, *size)).astype(np.float32)
    soft = before + chance.normal(0, 0.004, before.shape).astype(np.float32)
    soft[:, 8:24, 16:40] += 0.2
    planes = [chance.uniform(0, 0.01, size), chance.random(size), chance.random(size) < known]
    state = ground_start(before, params)
    state.before[...], state.soft[...] = before, soft
    state.restless[...], state.quiet[...], state.known[...] = planes
    other = copy.deepcopy(state)
    out = (chance.random(size) < 0.6).astype(np.uint8)
    plain = figures.stillness(out, state, DT, params)
    with torch.inference_mode():
        quick = figures.stillness(out, other, DT, params)
    assert np.allclose(state.quiet, other.quiet, atol=1e-6)
    assert np.allclose(state.restless, other.restless, atol=1e-6)
    assert plain == pytest.approx(quick)
    assert 0.08 < plain < 0.3
    assert 0.1 < (state.quiet == 0).mean() < 0.99


def test_what_lies_outside_of_all_silhouettes_is_not_sensed() -> None:
    """Though it differs from the ground as much as what lies inside."""
    signals = FigureSignals((32, 48), 1 / 25)
    picture, ground = torch.rand(3, 32, 48, generator=torch.Generator().manual_seed(0)), torch.zeros(3, 32, 48)
    silhouettes = torch.zeros(32, 48, dtype=torch.int32)
    silhouettes[8:24, 8:24] = 1
    nothing = torch.zeros(3, 16, 24)
    strongest, sums, _ = signals.sums(picture, ground, silhouettes, FieldsState(MotionState(nothing, nothing)))
    inside = torch.zeros(16, 24, dtype=torch.bool)
    inside[4:12, 4:12] = True
    assert not strongest[~inside].any()
    assert strongest[inside].min() > 0.05
    assert sums[0, 0] == inside.sum()


def test_an_exposure_beyond_its_limits_is_a_new_scene() -> None:
    """In two colors: one alone may be a lamp's."""
    ground = np.random.default_rng(0).uniform(0.2, 0.8, (3, 64, 64)).astype(np.float32)

    def new(*gain: float) -> bool:
        return light_change(ground * np.array(gain, np.float32)[:, None, None], ground, PARAMS)[2]

    for kernels in (False, True):
        with torch.inference_mode(kernels):
            assert not new(1, 1, 1)
            assert not new(4.1, 1, 1)
            assert not new(3.9, 3.9, 3.9)
            assert new(4.1, 4.1, 1)
            assert new(1, 0.24, 0.24)
            # Out of the dark.
            assert light_change(ground, ground * np.float32(0.01), PARAMS)[2]


def test_a_narrow_strip_may_be_a_shadow_and_a_broad_part_is_none() -> None:
    figure = np.zeros((100, 160), np.uint8)
    figure[40:44, 20:100] = figure[60:80, 20:100] = 1
    broad = figures.broad(figure, PARAMS)
    assert not broad[40:44].any()
    assert np.array_equal(broad[60:80], figure[60:80])
