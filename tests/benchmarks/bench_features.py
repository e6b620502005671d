"""The ten features beside what one would write with NumPy and SciPy's FFT."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy.fft
import torch

from ndtorch.arguments import set_backend
from ndtorch.scenes import two_bars
from ndtorch.vision import GROUPS, VisualFeatures
from ndtorch.vision.motion import MotionState
from tests.benchmarks.timing import Row, in_turn

Array = np.ndarray[Any, np.dtype[np.float32]]


def kernels(size: int) -> Array:
    """The three DoG kernels, sampled on `size` x `size` pixels, `[3, size, size]`."""
    y, x = np.mgrid[:size, :size] - size // 2
    out = []
    for angle in np.deg2rad([0, 60, 120]):
        along = -x * math.sin(angle) - y * math.cos(angle)
        across = x * math.cos(angle) - y * math.sin(angle)
        center = np.exp(-(along**2) / (2 * 19**2) - across**2 / (2 * 6**2))
        surround = np.exp(-(along**2) / (2 * 22**2) - across**2 / (2 * 9**2))
        out.append(center / center.sum() - surround / surround.sum())
    return np.stack(out).astype(np.float32)


class NumpyFeatures:
    """Ten sums of one frame `[3, H, W]` after the other."""

    def __init__(self, size: int, dt: float = 0.01) -> None:
        self.a_high, self.a_low = dt / (0.5 + dt), dt / (0.05 + dt)
        self.slow: Array | None = None
        self.delayed: Array | None = None
        self.spectrum = scipy.fft.rfft2(np.fft.ifftshift(kernels(size), axes=(-2, -1)))

    def __call__(self, frame: Array) -> Array:
        grey = frame.mean(0)
        if self.slow is None or self.delayed is None:
            self.slow, self.delayed = grey.copy(), np.zeros_like(grey)
        self.slow += self.a_high * (grey - self.slow)
        high = grey - self.slow
        self.delayed += self.a_low * (high - self.delayed)
        sums = []
        for axis in (1, 0):
            signed = np.roll(high, -1, axis) * self.delayed - high * np.roll(self.delayed, -1, axis)
            sums += [-signed[signed < 0].sum(), signed[signed > 0].sum()]
        left, right, up, down = sums
        responses = scipy.fft.irfft2(scipy.fft.rfft2(grey) * self.spectrum, s=grey.shape)
        oriented = np.abs(responses).sum((1, 2))
        return np.array([left, right, down, up, *oriented, *frame.sum((1, 2))], dtype=np.float32)


TITLE = "Ten features of a 500x500 frame (two moving bars)"


def rows(device: str | None = None) -> list[Row]:
    frames = torch.cat(list(two_bars(seconds=0.4).chunks(8)))
    arrays = [frame.numpy() for frame in frames]
    fast, exact = VisualFeatures(), VisualFeatures(exact=True)
    fft = NumpyFeatures(500)
    with torch.inference_mode():
        quick, state = fast(frames)
        full, _ = exact(frames)
        reference = torch.from_numpy(np.stack([fft(array) for array in arrays]))
        # Motion is silent on the first frame.
        error = ((quick - full).abs() / full)[1:, GROUPS["orientation"]].max()
        agree = ((full - reference).abs() / reference.abs().clamp_min(1e-3))[5:].max()
        chunk = frames[8:16]
        as_bytes = (chunk * 255).round().to(torch.uint8)
        jobs = {
            "fast": lambda: fast(chunk, state),
            "bytes": lambda: fast(as_bytes, state),
            "torch": lambda: without_kernels(fast, chunk, state),
            "exact": lambda: exact(chunk, state),
            "fft": lambda: [fft(array) for array in arrays[8:16]],
        }
        times = in_turn(jobs, rounds=15, repeat=2)
    per_frame = {name: seconds / 8 for name, seconds in times.items()}
    ms = {name: f"{1e3 * seconds:.2f} ms" for name, seconds in per_frame.items()}
    found = [
        Row(
            f"features{name}",
            ms[ours],
            f"NumPy + scipy.fft {ms['fft']}",
            f"{per_frame['fft'] / per_frame[ours]:.1f}x",
            per_frame[ours] / per_frame["fft"],
        )
        for ours, name in (("fast", ""), ("bytes", " of uint8"), ("torch", " without kernels"))
    ]
    found += [
        Row(
            "features, exact=True", ms["exact"], f"fast {ms['fast']}", f"{per_frame['exact'] / per_frame['fast']:.1f}x"
        ),
        Row("largest error of a fast sum", f"{100 * float(error):.2f} %", "exact", ""),
        Row("largest difference of an exact sum", f"{100 * float(agree):.3f} %", "NumPy + scipy.fft", ""),
    ]
    if device is not None:
        found.append(on_device(device))
    return found


def without_kernels(features: VisualFeatures, frames: torch.Tensor, state: MotionState) -> object:
    """The features by torch."""
    set_backend(features, "torch")
    try:
        return features(frames, state)
    finally:
        set_backend(features, "auto")


def on_device(device: str, count: int = 256, size: int = 500) -> Row:
    """Frames a second on another device, 256 at a time, beside what its memory allows: frames read once."""
    features = VisualFeatures((size, size)).to(device)
    batch = torch.rand(count, 3, size, size, device=device)
    with torch.inference_mode():
        _, state = features(batch)
        jobs = {"step": lambda: features(batch, state)[0].cpu(), "copy": batch.clone}
        times = in_turn(jobs, rounds=5, repeat=3)
    bound = count / (times["copy"] / 2)  # a copy reads and writes
    rate = count / times["step"]
    return Row(
        f"features on {device}, {count} frames a call",
        f"{rate:.0f} frames/s",
        f"reading the frames once {bound:.0f} frames/s",
        f"{rate / bound:.3f}x",
    )
