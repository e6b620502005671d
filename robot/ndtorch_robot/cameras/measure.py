"""How well a pair of cameras does: rate, latency and its spread, skew."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np

from ndtorch_robot.cameras.pair import SIDES, CamerasSilent, FramesEnded, StereoCameras
from ndtorch_robot.cameras.pairing import Frame, Pair


class FrameTimes:
    """Notes when every frame was taken and when it was here."""

    def __init__(self) -> None:
        self.times: tuple[list[tuple[float, float]], ...] = ([], [])
        self.lock = threading.Lock()

    def watch(self, cameras: StereoCameras) -> None:
        """Look over the shoulder of the pairing from now on."""
        add = cameras.pairing.add

        def noting(side: int, frame: Frame) -> Pair | None:
            with self.lock:
                self.times[side].append((frame.time, frame.arrived))
            return add(side, frame)

        cameras.pairing.add = noting  # type: ignore[method-assign]


def measure(cameras: StereoCameras, seconds: float) -> dict[str, Any]:
    """Read pairs for some seconds, or to the end of a file.

    Returns:
        For each camera `rate_hz`, `interval_ms` (p1, p50, p99) and `latency_ms` (p50, p99, max: from when a frame
        was taken until it was decoded; files are taken when they are due); `skew_ms`, `pairs`, `unpaired`,
        `silences`.
    """
    times = FrameTimes()
    times.watch(cameras)
    until = time.monotonic() + seconds
    silences: list[str] = []
    ended = ""
    while time.monotonic() < until:
        try:
            cameras.read_pair()
        except CamerasSilent as silence:
            silences.append(str(silence))
        except FramesEnded as end:
            ended = str(end)
            break
    statistics = cameras.statistics()
    result: dict[str, Any] = {}
    for side, name in enumerate(SIDES):
        result[name] = figures(np.array(times.times[side]).reshape(-1, 2))
    return result | {
        "skew_ms": statistics.skew_ms(),
        "pairs": statistics.pairs,
        "unpaired": statistics.unpaired,
        "silences": len(silences),
        "last_silence": silences[-1] if silences else "",
        "ended": ended,
    }


def figures(times: np.ndarray[Any, np.dtype[np.float64]]) -> dict[str, Any]:
    """Rate, intervals and latency from `[n, 2]` times of taking and arrival."""
    if len(times) < 3:
        return {"frames": len(times)}
    gaps, latency = np.diff(times[:, 0]) * 1e3, (times[:, 1] - times[:, 0]) * 1e3
    p1, p50, p99 = np.percentile(gaps, (1, 50, 99))
    late50, late99 = np.percentile(latency, (50, 99))
    return {
        "frames": len(times),
        "rate_hz": float((len(times) - 1) / (times[-1, 0] - times[0, 0])),
        "interval_ms": {"p1": float(p1), "p50": float(p50), "p99": float(p99)},
        "latency_ms": {"p50": float(late50), "p99": float(late99), "max": float(latency.max())},
    }
