"""Ten features of a 500x500 frame: this library beside NumPy with SciPy's FFT and with OpenCV's filter2D."""

from __future__ import annotations

import cv2
import numpy as np
import torch

from ndtorch.binding import ObjectFiles
from ndtorch.scenes import two_bars
from ndtorch.utils.backend import set_backend
from ndtorch.vision import GROUPS, LocalFeatures, VisualFeatures
from ndtorch.vision.motion import MotionState
from tests.benchmarks.numpy_features import NumpyFeatures
from tests.benchmarks.timing import Row, in_turn

TITLE = "Ten features of a 500x500 frame (two moving bars)"


def rows(device: str | None = None) -> list[Row]:
    cv2.setNumThreads(1)
    frames = torch.cat(list(two_bars(seconds=0.4).chunks(8)))
    arrays = [frame.numpy() for frame in frames]
    fast, exact = VisualFeatures(), VisualFeatures(exact=True)
    fft, filter2d = NumpyFeatures(500, "fft"), NumpyFeatures(500, "filter2d")
    with torch.inference_mode():
        quick, state = fast(frames)
        full, _ = exact(frames)
        reference = torch.from_numpy(np.stack([fft(array) for array in arrays]))
        # Motion is silent on the first frame.
        error = ((quick - full).abs() / full)[1:, GROUPS["orientation"]].max()
        agree = ((full - reference).abs() / reference.abs().clamp_min(1e-3))[5:].max()
        chunk = frames[8:16]
        as_bytes = (chunk * 255).round().to(torch.uint8)
        local = LocalFeatures(fast)
        binding = ObjectFiles(local.grid, local.spacing)
        signals, seen = local(chunk, state)
        _, files = binding(signals)
        jobs = {
            "fast": lambda: fast(chunk, state),
            "bytes": lambda: fast(as_bytes, state),
            "torch": lambda: without_kernels(fast, chunk, state),
            "exact": lambda: exact(chunk, state),
            "local": lambda: local(chunk, seen),
            "files": lambda: binding(signals, files),
            "fft": lambda: [fft(array) for array in arrays[8:16]],
            "filter2d": lambda: [filter2d(array) for array in arrays[8:10]],
        }
        times = in_turn(jobs, rounds=15, repeat=2)
    per_frame = {name: seconds / (2 if name == "filter2d" else 8) for name, seconds in times.items()}
    ms = {name: f"{1e3 * seconds:.2f} ms" for name, seconds in per_frame.items()}
    found = [
        Row(
            f"features{name}",
            ms[ours],
            f"NumPy + {other} {ms[theirs]}",
            f"{per_frame[theirs] / per_frame[ours]:.1f}x",
            per_frame[ours] / per_frame["fft"] if theirs == "fft" else None,
        )
        for ours, name in (("fast", ""), ("bytes", " of uint8"), ("torch", " without kernels"))
        for theirs, other in (("fft", "scipy.fft"), ("filter2d", "cv2.filter2D"))
    ]
    found += [
        Row(
            "features, exact=True", ms["exact"], f"fast {ms['fast']}", f"{per_frame['exact'] / per_frame['fast']:.1f}x"
        ),
        Row(
            "the same in 16x16 receptive fields",
            ms["local"],
            f"fast {ms['fast']}",
            f"{per_frame['local'] / per_frame['fast']:.1f}x",
        ),
        Row("retinotopic binding of those", ms["files"], "10 ms of signal", f"{0.01 / per_frame['files']:.0f}x"),
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


def on_device(device: str) -> Row:
    """Frames a second on another device, 64 at a time."""
    features = VisualFeatures().to(device)
    batch = torch.rand(64, 3, 500, 500, device=device)
    with torch.inference_mode():
        _, state = features(batch)

        def step() -> None:
            features(batch, state)[0].cpu()

        seconds = in_turn({"step": step}, rounds=5, repeat=3)["step"]
    return Row(f"features on {device}, 64 frames a call", f"{64 / seconds:.0f} frames/s", "", "")
