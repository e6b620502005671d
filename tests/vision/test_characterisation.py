"""The published characterisation of the speed sensors: claims A1 and A2."""

import math

import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.scenes.gratings import FlickeringGrating, MovingGrating
from ndtorch.vision.chahl_srinivasan import ChahlSrinivasan
from ndtorch.vision.characterisation import judge_speed_curve, speed_response
from ndtorch.vision.nondirectional import NDS, SPEED_SCALE, NDMin, NDMinus

PHASES = [k / 16 + 0.03 for k in range(16)]


def response(sensor, speeds, settle=10, phases=PHASES, **options):
    """Mean response to each speed over the start phases, in raw units."""
    source = MovingGrating(speeds, phases, length=settle + 200, **options)
    return speed_response(sensor, source.chunks(32), settle)[..., 0].mean(1)


@pytest.mark.parametrize(
    ("sensor", "at_one", "at_two"), [(NDS(), 1.49, 2.71), (NDMinus(), 0.77, 0.62), (NDMin(), 1.00, 1.30)]
)
def test_published_responses(sensor, at_one, at_two):
    """A1: x20 at 1 and 2 pixels a step, within 3 %, the same to the left and to the right."""
    found = SPEED_SCALE * response(sensor, [-2.0, -1.0, 0.0, 1.0, 2.0])
    assert found[2] == 0
    assert found[3:].tolist() == pytest.approx([at_one, at_two], rel=0.03)
    assert found[:2].flip(0).tolist() == pytest.approx([at_one, at_two], rel=0.03)


def test_published_chahl_srinivasan_response():
    """A1: signed, right to 1 pixel a step and saturated beyond."""
    speeds = [-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0]
    source = MovingGrating(speeds, PHASES, length=201)
    rows = torch.cat(list(source.chunks(32)), 2)
    found = ChahlSrinivasan()(rows)[0][..., 1:, 0].mean((-1, -2))
    assert found[[0, 1, 3, 5, 6]].tolist() == pytest.approx([-1.21, -1.0, 0.0, 1.0, 1.21], rel=0.03, abs=1e-6)
    assert found[[2, 4]].tolist() == pytest.approx([-0.5, 0.5], abs=0.1)


def test_saturation_order():
    """A1: NDS saturates least, ND-minus declines, ND-min is flat beyond 2 pixels a step."""
    speeds = [0.5, 1.0, 1.5, 2.0, 2.5, 3.0]
    nds, minus, least = (response(s, speeds) for s in (NDS(), NDMinus(), NDMin()))
    assert (nds / nds[0])[3] > (least / least[0])[3] > (minus / minus[0])[3]
    assert nds[5] > 1.1 * nds[3]
    assert minus[3] < 0.85 * minus[1]
    assert least[5] == pytest.approx(float(least[3]), rel=0.01)


def test_flicker():
    """A1: ND-minus answers flicker least, and a uniform flicker not at all."""
    grating, uniform = FlickeringGrating(length=200), FlickeringGrating(length=200, uniform=True)
    nds, minus, least = (float(speed_response(s, grating.chunks(), 10)[0]) for s in (NDS(), NDMinus(), NDMin()))
    assert minus < 0.5 * least < least < nds
    assert speed_response(NDMinus(), uniform.chunks())[0] == 0
    assert speed_response(NDMin(), uniform.chunks())[0] > 0
    # The same in one chunk; and nothing is left of 200 frames that settle.
    assert float(speed_response(NDMin(), grating.chunks(200), 10)[0]) == pytest.approx(least, rel=1e-5)
    with pytest.raises(InputError, match="settle=200 leaves none of the 200 frames"):
        speed_response(NDMin(), grating.chunks(), 200)


TAUS = [0.0, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, math.inf]


def curve(sensor, *taus):
    speeds = [0.25 * k for k in range(1, 9)]
    settle = max([0] + [math.ceil(5 * tau * 30) for tau in taus if tau < math.inf])
    found = judge_speed_curve(torch.tensor(speeds), response(sensor(*taus), speeds, settle, PHASES[::2], width=160))
    return float(found.monotonic_to), float(found.linearity)


@pytest.mark.parametrize("sensor", [NDMin, NDMinus])
def test_sweep_of_the_high_pass(sensor):
    """A2: the smallest time constant above zero is best."""
    assert max(TAUS, key=lambda tau: curve(sensor, tau)) == 0.005


@pytest.mark.parametrize("taus", [[0.0, 0.005, 0.01, 0.1, math.inf], pytest.param(TAUS, marks=pytest.mark.long)])
def test_sweep_of_both_time_constants(taus):
    """A2: NDS wants 5 ms and no low-pass."""
    pairs = [(high, low) for high in taus for low in taus]
    assert max(pairs, key=lambda pair: curve(NDS, *pair)) == (0.005, 0.0)


def test_judge_speed_curve_by_hand():
    speeds = torch.tensor([1.0, 2.0, 3.0, 4.0])
    curves = torch.tensor([[1.0, 2.0, 3.0, 4.0], [1.0, 1.5, 1.2, 2.0], [0.0, 0.0, 0.0, 0.0]])
    found = judge_speed_curve(speeds, curves)
    assert found.monotonic_to.tolist() == [4.0, 2.0, 0.0]
    assert found.linearity.tolist() == [1.0, 0.75, 0.0]
