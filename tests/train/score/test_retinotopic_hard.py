"""Hard scenes as fields see them."""

from __future__ import annotations

import torch

from ndtorch_train.score.hard import HARD
from ndtorch_train.score.retinotopic_hard import local_disturbance

SETS = {hard.name: hard for hard in HARD}


def test_noise_is_each_fields_own_and_a_lamp_shines_on_all() -> None:
    signals = torch.zeros(200, 3, 3, 10)
    signals[::2, 1, 1] = 1.0
    deviation = signals.std(0).amax()
    noise = local_disturbance(SETS["white 0.3"], 5, signals)
    torch.testing.assert_close(noise.std(), 0.3 * deviation, rtol=0.05, atol=0)
    assert (noise[:, 0, 0] - noise[:, 2, 2]).std() > 0.3 * deviation
    lamp = local_disturbance(SETS["lamp"], 5, signals)
    assert not lamp[..., :4].any()
    assert torch.equal(lamp[:, 0, 0], lamp[:, 2, 2])
