"""Encoding generated clips: H.264 by libx264 where PyAV is installed, else MPEG-4 by OpenCV."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ndtorch.errors import InputError

Frame = npt.NDArray[np.uint8]


def codec() -> str:
    """The encoder in use: "libx264", or "mp4v" where that is missing."""
    try:
        import av
    except ImportError:
        return "mp4v"
    return "libx264" if "libx264" in av.codecs_available else "mp4v"


def encode(frames: Iterable[Frame], path: Path, fps: float, size: tuple[int, int], quality: int) -> str:
    """Write frames `[H, W, 3]` (red, green, blue) into an .mp4; returns the encoder used.

    Args:
        frames: uint8.
        path: file to write.
        fps: frames a second.
        size: height and width, both even.
        quality: constant rate factor for H.264, 0 (lossless) to 51.

    Raises:
        InputError: the file cannot be written.
    """
    used = codec()
    (_h264 if used == "libx264" else _mpeg4)(frames, path, fps, size, quality)
    return used


def _h264(frames: Iterable[Frame], path: Path, fps: float, size: tuple[int, int], quality: int) -> None:
    import av

    try:
        container: Any = av.open(str(path), "w")
    except OSError as error:
        raise InputError(f"video {path} cannot be written: {error}") from None
    with container:
        stream = container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1000))
        stream.height, stream.width, stream.pix_fmt = size[0], size[1], "yuv420p"
        stream.options = {"crf": str(quality), "preset": "veryfast", "threads": "1"}
        for frame in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        container.mux(stream.encode())


def _mpeg4(frames: Iterable[Frame], path: Path, fps: float, size: tuple[int, int], quality: int) -> None:
    import torch

    from ndtorch.scenes.video_writer import VideoWriter

    with VideoWriter(path, fps, size) as writer:
        for frame in frames:
            writer.write(torch.from_numpy(frame).permute(2, 0, 1))
