"""What tests of the command line share."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from ndtorch.cli.commands import main
from ndtorch.scenes import two_bars
from ndtorch.scenes.video_writer import VideoWriter

SMALL = (160, 160)


def small_clip(path: Path) -> Path:
    """One second of the two bars at 25 frames a second as a video file."""
    with VideoWriter(path, 25, SMALL) as writer:
        for chunk in two_bars(seconds=1.0, size=SMALL, fps=25).chunks():
            for frame in chunk:
                writer.write(frame)
    return path


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str], *words: str) -> None:
    """The command ends with code 2, one line that holds the words, and nothing on stdout."""
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    lines = [line for line in err.splitlines() if line.startswith("error:")]
    assert out == ""
    assert len(lines) == 1
    for word in words:
        assert word in lines[0]


def kept(out: Path) -> dict[str, torch.Tensor]:
    """Every tensor of the state that a run left."""
    return load_file(out / "state.safetensors")


def same_state(whole: Path, rest: Path) -> dict[str, torch.Tensor]:
    """Both runs ended in the same state, bit for bit; gives it."""
    one, other = kept(whole), kept(rest)
    assert set(one) == set(other)
    assert [name for name in one if not torch.equal(one[name], other[name])] == []
    return one
