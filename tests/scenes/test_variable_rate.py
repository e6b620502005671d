"""Files of a variable frame rate: times come from the frames' own time stamps."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

import ndtorch
from ndtorch.run.run import run_model
from ndtorch.scenes.readers import rate_of
from ndtorch.scenes.video import open_video
from tests.foreground.passing_scenes import SIZE, ground
from tests.scenes.clips import film

# Half of a second at 50 frames a second, then 25, then 8.
TIMES = [n / 50 for n in range(25)] + [0.5 + n / 25 for n in range(75)] + [3.5 + n / 8 for n in range(20)]
FROM, TO = 1.0, 3.0


def clip(path: Path, suffix: str) -> Path:
    """A red square is there from 1 to 3 s, going right; frames have the time stamps `TIMES`."""
    still = ground()

    def passing(time: float) -> torch.Tensor:
        picture = still.clone()
        if FROM <= time < TO:
            left = round(85 * (time - FROM))
            picture[:, 44:68, left : left + 24] = torch.tensor([0.8, 0.2, 0.2])[:, None, None]
        return picture

    pictures = [(passing(time) * 255).to(torch.uint8).permute(1, 2, 0).numpy() for time in TIMES]
    return film(path / f"clip.{suffix}", pictures, TIMES)


@pytest.mark.parametrize("suffix", ["mp4", pytest.param("mkv", marks=pytest.mark.long)])
def test_an_object_is_reported_when_it_is_there(tmp_path: Path, suffix: str) -> None:
    source = open_video(clip(tmp_path, suffix), SIZE)
    result = run_model(ndtorch.load("foreground", size=SIZE, fps=source.fps), source, pictures_per_second=0)
    assert result.simulated_seconds == pytest.approx(TIMES[-1] + 1 / 8, abs=0.15)
    (thing,) = result.objects
    assert (thing.color, thing.direction) == ("red", "right")
    assert FROM <= thing.first_seen < FROM + 0.7
    assert TO - 0.5 < thing.last_seen < TO + 0.2


def test_a_rate_that_is_given_takes_frames_as_they_follow(tmp_path: Path) -> None:
    with open_video(clip(tmp_path, "mp4"), SIZE, fps=25.0) as source:
        assert sum(len(frames) for frames in source.chunks()) == len(TIMES)


@pytest.mark.parametrize("together", [0.0, 0.001])
def test_a_rate_is_frames_over_time_where_three_arrive_at_once(together: float) -> None:
    stamps = [0.1 * (n // 3) + together * (n % 3) for n in range(91)]
    assert rate_of(stamps, ()) == pytest.approx(30)
