"""Navigation beside OpenCV's dense stereo and optical flow: same frames, same process, one thread.

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
    ObservationList,
    Pose,
    StereoRanging,
    StereoRig,
    Strips,
    cut_strips,
)
from ndtorch.navigation.controllers.published import SaccadeAvoidance, SubfieldMotion
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.proximity import ProximityCheck
from ndtorch.navigation.stereo.strips import as_frames
from tests.benchmarks.timing import Row, reference, table

DT = 1 / 30
CARS = 64
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
    """Time everything once; about 20 seconds."""
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    pairs = [stereo_pair(step) for step in range(3)]
    tensors = [
        tuple(torch.from_numpy(image).permute(2, 0, 1).contiguous().unsqueeze(0) for image in pair) for pair in pairs
    ]
    grey = [tuple(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in pair) for pair in pairs]
    with torch.inference_mode():
        return navigation_rows(tensors) + opencv_rows(grey)


def navigation_rows(tensors: list[tuple[torch.Tensor, ...]]) -> list[Timed]:
    """The parts and the whole of a navigation step, from whole uint8 RGB frames."""
    rig = StereoRig()
    (left, right), (next_left, next_right) = tensors[1], tensors[2]
    motion, avoidance, ranging, grid = (
        SubfieldMotion(rig, DT),
        SaccadeAvoidance(DT),
        StereoRanging(rig, DT),
        GridMap(rig),
    )
    sides, fields = motion(left, right)
    _, steering = avoidance(sides)
    _, rows_state = ranging(left, right)
    here = Pose(*torch.zeros(3, 1))
    ranges, _ = ranging(next_left, next_right, rows_state)
    _, cells = grid(ranges, here)

    def avoid() -> object:
        return avoidance(motion(next_left, next_right, fields)[0], steering)

    def range_and_map() -> object:
        return grid(ranging(next_left, next_right, rows_state)[0], here, cells)

    found = int(ranges.valid.sum())
    control, origin = RangingControl(rig, DT), Pose(0.0, 0.0, 0.0)
    frames = as_frames(left[0], right[0])
    _, _, floor = control.see(frames)
    start, found_now = control.start(None, origin), StereoRanging(rig, DT).step(frames, None)[0]

    check = ProximityCheck(rig, control.fields)

    def near() -> object:
        return check(frames, frames)

    def drive() -> object:
        seen, _, _ = control.see(as_frames(next_left[0], next_right[0]), floor)
        return control.step(seen, found_now, origin, Command(0.5, 0.0), start)

    result = [
        Timed("ranging controller", *median_time(drive), "floor cells, patch, free arcs, state machine"),
        Timed("avoidance step", *median_time(avoid), "subfields, ND-min, maxima, state machine"),
        Timed("near check of a car that stands", *median_time(near), "both rows compared, floor right ahead"),
        Timed("features, ranges and grid map", *median_time(range_and_map), f"5 features, {found} ranges"),
    ]
    for name, navigator in {
        WHOLE: Navigator(rig, DT, controller="published"),
        "whole step with grid map": Navigator(rig, DT, controller="published", grid_map=GridMap(rig)),
        "whole step with observation list": Navigator(
            rig, DT, controller="published", observations=ObservationList(DT)
        ),
        "whole step, ranging controller": Navigator(rig, DT, controller="ranging", features=FeatureParams()),
        "whole step, ranging controller, row search": Navigator(rig, DT, controller="ranging"),
        "whole step, 7 features at edges": Navigator(rig, DT, controller="published", features=EDGES),
        "what `ndtorch drive` does": Navigator(rig, DT, features=EDGES, grid_map=GridMap(rig)),
    }.items():
        state = None
        # Until it knows its floor.
        for n in range(30):
            _, state = navigator(*tensors[n % 3], state, Command(torch.tensor([0.5]), torch.zeros(1)))
        call = lambda n=navigator, s=state: n(next_left, next_right, s)  # noqa: E731
        result.append(Timed(name, *median_time(call), "two 640x480 RGB frames, uint8"))
        if name in (WHOLE, "whole step, ranging controller"):
            eyes = [beside(frame) for frame in (next_left, next_right)]
            of_camera = lambda n=navigator, s=state, e=eyes: n(*e, s)  # noqa: E731
            result.append(Timed(f"{name}, frames of OpenCV", *median_time(of_camera), "colors beside each other"))
    return [*result, *many_cars(tensors)]


def beside(frame: torch.Tensor) -> torch.Tensor:
    """The same frame `[1, C, H, W]` with the colors of a pixel beside each other in memory."""
    return frame.contiguous(memory_format=torch.channels_last)


def many_cars(tensors: list[tuple[torch.Tensor, ...]]) -> list[Timed]:
    """Of a step of 64 cars, what one car takes; strips, as the simulator gives them."""
    result, rig = [], StereoRig()
    for name in ("published", "ranging"):
        navigator = Navigator(rig, DT, controller=name)
        fields, state = navigator.controller.fields, None
        moved = Command(torch.full((CARS, 1), 0.5), torch.zeros(CARS, 1))
        cut = [
            [cut_strips(eye.expand(CARS, *eye.shape), f, rig) for eye, f in zip(pair, fields, strict=True)]
            for pair in tensors
        ]
        eyes = [[Strips(*(part.contiguous() for part in eye)) for eye in pair] for pair in cut]
        for n in range(30):
            _, state = navigator(*eyes[n % 3], state, moved)
        call = lambda n=navigator, e=eyes[0], s=state: n(*e, s, moved)  # noqa: E731, B023
        time_of_all, cost = median_time(call, 0.5)
        result.append(Timed(f"{CARS} cars, {name}, one car's share", time_of_all / CARS, cost / CARS, "uint8 strips"))
    return result


def opencv_rows(grey: list[tuple[np.ndarray, ...]]) -> list[Timed]:
    """Dense stereo over the same disparities, and dense flow of one camera, on grey frames."""
    (left, right), (next_left, _) = grey[1], grey[2]
    sgbm = cv2.StereoSGBM.create(minDisparity=0, numDisparities=208, blockSize=5, P1=8 * 25, P2=32 * 25)
    bm = cv2.StereoBM.create(numDisparities=208, blockSize=15)
    result = [
        Timed("cv2.StereoSGBM", *median_time(lambda: sgbm.compute(left, right), 0.2), "208 disparities, block 5"),
        Timed("cv2.StereoBM", *median_time(lambda: bm.compute(left, right), 0.2), "208 disparities, block 15"),
    ]
    presets = {
        "ultrafast": cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
        "fast": cv2.DISOPTICAL_FLOW_PRESET_FAST,
        "medium": cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
    }
    for name, preset in presets.items():
        dis = cv2.DISOpticalFlow.create(preset)
        call = lambda d=dis: d.calc(left, next_left, None)  # noqa: E731
        result.append(Timed(f"cv2.DISOpticalFlow {name}", *median_time(call, 0.2), "one camera"))
    return result


if __name__ == "__main__":
    print(table(TITLE, rows()))
