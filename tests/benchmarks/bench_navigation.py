"""Navigation beside OpenCV's dense stereo: same frames, same process, one thread.

`python -m tests.benchmarks.bench_navigation`
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np
import torch

from ndtorch.navigation import (
    Command,
    FeatureParams,
    GridMap,
    Navigator,
    StereoRig,
)
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.proximity import ProximityCheck
from ndtorch.navigation.stereo.strips import as_frames
from tests.benchmarks.timing import Row, reference, table

DT = 1 / 30
WHOLE = "whole navigation step"
EDGES = FeatureParams(7, edge_reach_px=4, shared=True)
"""As the simulated drives have it."""


TITLE = "Navigation (two 640x480 RGB frames)"


class Timed(NamedTuple):
    """What ran, the median time of one call, and what it did."""

    name: str
    microseconds: float
    cost: float
    note: str


def median_time(call: Callable[[], object], seconds: float = 0.2, most: int = 2000) -> tuple[float, float]:
    """Median duration of single calls, in microseconds and over that of `reference`, after a short warm-up."""
    for _ in range(5):
        call()
    times: list[float] = []
    others: list[float] = []
    end = time.thread_time() + seconds
    while len(times) < 5 or (time.thread_time() < end and len(times) < most):
        for job, taken in ((call, times), (reference, others)):
            start = time.thread_time()
            job()
            taken.append(time.thread_time() - start)
    middle = statistics.median(times)
    return 1e6 * middle, middle / statistics.median(others)


def stereo_pair(step: int) -> tuple[np.ndarray, np.ndarray]:
    """Two 640x480 RGB frames of a textured plane 1.3 m away that slides by 2 pixels a step."""
    rng = np.random.default_rng(0)
    coarse = rng.integers(0, 256, (48, 110, 3), dtype=np.uint8)
    wide = cv2.resize(coarse, (1100, 480), interpolation=cv2.INTER_CUBIC)
    shift = 2 * step
    return (
        np.ascontiguousarray(wide[:, shift : shift + 640]),
        np.ascontiguousarray(wide[:, shift + 100 : shift + 740]),
    )


def rows(device: str | None = None) -> list[Row]:
    """Everything beside the whole navigation step; on the CPU whatever the device: the robot has no other."""
    found = timings()
    whole = next(timed.microseconds for timed in found if timed.name == WHOLE)
    return [
        Row(
            f"{timed.name} ({timed.note})",
            f"{timed.microseconds:.0f} us, {1e6 / timed.microseconds:.0f}/s",
            "whole navigation step",
            f"{timed.microseconds / whole:.2f}x",
            timed.cost,
        )
        for timed in found
    ]


def timings() -> list[Timed]:
    """Time everything once; about 5 seconds."""
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    pairs = [stereo_pair(step) for step in range(3)]
    tensors = [
        tuple(torch.from_numpy(image).permute(2, 0, 1).contiguous().unsqueeze(0) for image in pair) for pair in pairs
    ]
    grey = [tuple(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in pair) for pair in pairs]
    with torch.inference_mode():
        found = navigation_rows(tensors)
    left, right = grey[1]
    sgbm = cv2.StereoSGBM.create(minDisparity=0, numDisparities=208, blockSize=5, P1=8 * 25, P2=32 * 25)
    dense = median_time(lambda: sgbm.compute(left, right), 0.2)
    return [*found, Timed("cv2.StereoSGBM", *dense, "grey frames, 208 disparities, block 5")]


def navigation_rows(tensors: list[tuple[torch.Tensor, ...]]) -> list[Timed]:
    """Whole navigation steps and the near check, from whole uint8 RGB frames."""
    rig = StereoRig()
    (left, right), (next_left, next_right) = tensors[1], tensors[2]
    frames = as_frames(left[0], right[0])
    check = ProximityCheck(rig, RangingControl(rig, DT).fields)
    near = median_time(lambda: check(frames, frames))
    result = [Timed("near check of a car that stands", *near, "both rows compared, floor right ahead")]
    for name, navigator in {
        WHOLE: Navigator(rig, DT, controller="published"),
        "whole step with grid map": Navigator(rig, DT, controller="published", grid_map=GridMap(rig)),
        "whole step, ranging controller": Navigator(rig, DT, controller="ranging", features=FeatureParams()),
        "whole step, ranging controller, row search": Navigator(rig, DT, controller="ranging"),
        "what `ndtorch drive` does": Navigator(rig, DT, features=EDGES, grid_map=GridMap(rig)),
    }.items():
        state = None
        # Until it knows its floor.
        for n in range(30):
            _, state = navigator(*tensors[n % 3], state, Command(torch.tensor([0.5]), torch.zeros(1)))
        call = lambda n=navigator, s=state: n(next_left, next_right, s)  # noqa: E731
        result.append(Timed(name, *median_time(call), "two 640x480 RGB frames, uint8"))
    return result


if __name__ == "__main__":
    print(table(TITLE, rows()))
