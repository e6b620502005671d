"""Hard scenes as fields see them."""

from __future__ import annotations

import torch

from ndtorch_train.score.hard import HARD, arrived
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


def test_every_sample_of_the_fields_is_seen_once() -> None:
    """They were repeated five times, so that all went at a fifth of its speed."""
    kept = arrived(SETS["white 0.3"], [1], 100, 5)[0]
    assert (kept // 5).tolist() == list(range(20))
    lossy = SETS["12.5/s, 10 % lost"]
    late = arrived(lossy, [1], 8000, lossy.every)[0]
    assert len(late) == 1000
    assert 0.02 < (late[1:] == late[:-1]).double().mean() < 0.25
