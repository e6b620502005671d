"""Memory of a long run: minutes of video in under a gigabyte, no matter how long."""

from __future__ import annotations

import contextlib
import gc
import subprocess
import sys
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
from torch._subclasses.fake_tensor import FakeTensor

import ndtorch
from ndtorch.run.run import run_model
from ndtorch.scenes import FrameSource

# A process of its own: the peak of this one belongs to whatever test ran before.
PROGRAM = """
import re
from collections.abc import Iterator
from pathlib import Path

import torch
from torch import Tensor

import ndtorch
from ndtorch.utils.tensors import tune_allocator
from ndtorch.run.run import run_model
from ndtorch.scenes import FrameSource

torch.set_num_threads(1)
tune_allocator()


def peak() -> float:
    # Not getrusage: its maximum is handed down from the process that started this one.
    return int(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) / 1024


class Video(FrameSource):
    name, fps, size, length = "noise", 12.5, (500, 500), 5000

    def chunks(self, frames: int = 8, start: int = 0) -> Iterator[Tensor]:
        generator = torch.Generator().manual_seed(0)
        background = torch.randint(0, 200, (3, 500, 500), generator=generator, dtype=torch.uint8)
        for first in range(start, self.length, frames):
            chunk = background.repeat(min(frames, self.length - first), 1, 1, 1)
            chunk[..., (first * 3) % 400 :, :100] += 50
            yield chunk


seen = 0
marks = []


def report(frames: int) -> None:
    global seen
    seen += frames
    if seen % 1000 < frames:
        marks.append(peak())


model = ndtorch.load("published", fps=12.5, border="reflect")
result = run_model(model, Video(), pictures_per_second=0.5, report=report)
assert result.frames == 5000
print(*marks)
"""


def alive() -> int:
    """Bytes of all tensors that anybody holds, and of all that Python and NumPy have taken since tracing began."""
    gc.collect()
    held = {}
    for thing in gc.get_objects():
        # Exports that ran before may have left tensors without memory.
        if issubclass(type(thing), torch.Tensor) and type(thing) is not FakeTensor:
            storage = thing.untyped_storage()
            # Tensors without memory, which programs that were exported leave behind, have no pointer.
            with contextlib.suppress(RuntimeError):
                held[storage.data_ptr()] = storage.nbytes()
    return sum(held.values()) + tracemalloc.get_traced_memory()[0]


class Noise(FrameSource):
    """Noise that is new in every frame; every so many frames one more is kept, if wanted."""

    name, fps, size, length = "noise", 25.0, (96, 96), 144

    def __init__(self, keep: int = 0) -> None:
        self.keep, self.kept = keep, list[torch.Tensor]()

    def chunks(self, frames: int = 8, start: int = 0) -> Iterator[torch.Tensor]:
        for first in range(start, self.length, frames):
            chunk = torch.randint(0, 256, (min(frames, self.length - first), 3, *self.size), dtype=torch.uint8)
            if self.keep and first // self.keep != (first + frames) // self.keep:
                self.kept.append(chunk[0].clone())
            yield chunk


def growth(source: Noise) -> float:
    """What is held after 144 frames more than after 48, in frames of one byte a pixel and color."""
    marks: list[int] = []
    seen = 0

    def report(frames: int) -> None:
        nonlocal seen
        seen += frames
        if seen in (48, 144):
            marks.append(alive())

    model = ndtorch.load("published", size=source.size, fps=source.fps, border="reflect")
    tracemalloc.start()
    try:
        run_model(model, source, pictures_per_second=0, report=report)
    finally:
        tracemalloc.stop()
    assert len(marks) == 2
    return (marks[1] - marks[0]) / (3 * source.size[0] * source.size[1])


@pytest.mark.slow
def test_no_frame_is_kept() -> None:
    """Of 96 frames nothing stays but samples for the figures. One frame kept in eight would be twelve.

    Without pictures: up to twenty frames are kept of the moments at which objects stood out.
    """
    assert growth(Noise()) < 5
    assert growth(Noise(keep=8)) > 11


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads /proc")
def test_minutes_of_video_stay_under_a_gigabyte() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    megabytes = [float(word) for word in done.stdout.split()]
    assert len(megabytes) == 5
    assert megabytes[-1] < 1000
    # From then on nothing grows but holes between blocks (0-45 MB seen); one frame kept in thirty would add 100 MB.
    assert megabytes[-1] - megabytes[0] < 80
