"""Speed against the size of frames, and numbers of fields, of neurons and of features; and what two processes do.

`python -m tests.benchmarks.bench_sizes [--two]`; `--two` wants a machine with nothing else to do: it goes by the clock.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable

import torch
import torch.nn.functional as F

from ndtorch.binding import InhibitoryNetwork
from ndtorch.navigation import FeatureParams, Navigator, StereoRig
from ndtorch.vision import LocalFeatures, OrientedDoG, VisualFeatures
from tests.benchmarks.bench_navigation import DT, stereo_pair
from tests.benchmarks.timing import Row, in_turn, reference, table

SIZES = ((224, 398), (480, 640), (500, 500), (720, 1280), (1080, 1920))
GRIDS = (4, 8, 16, 32)
NEURONS = (5, 10, 20, 40)
FOUND = (5, 7, 14, 28)
STEPS = 100
SECONDS = 5.0


def rows() -> list[Row]:
    """Frames of noise, uint8 and with mirrored edges as those of a video, eight a call."""
    jobs = {}
    with torch.inference_mode():
        for size in SIZES:
            features = VisualFeatures(size, border="reflect")
            frames = torch.randint(0, 256, (8, 3, *size), dtype=torch.uint8)
            _, state = features(frames)
            jobs[f"{size[1]}x{size[0]}"] = lambda f=features, x=frames, s=state: f(x, s)
        times = in_turn({"transform": reference, **jobs}, rounds=9, repeat=1)
    unit, found = times.pop("transform"), []
    for (name, seconds), (height, width) in zip(times.items(), SIZES, strict=True):
        one = seconds / 8
        found.append(
            Row(
                f"ten features, {name}",
                f"{1e3 * one:.2f} ms, {one / unit:.1f} transforms",
                "a million pixels",
                f"{1e9 * one / (height * width):.2f} ms, {1e6 * one / unit / (height * width):.1f} transforms",
                one / unit,
            )
        )
    return found


def measured(jobs: dict[str, Callable[[], object]], calls: dict[str, int], against: str) -> list[Row]:
    """A row for each job: one of so many `calls` that it makes, beside the job named `against`."""
    with torch.inference_mode():
        times = in_turn({"transform": reference, **jobs}, rounds=9, repeat=1)
    unit = times.pop("transform")
    each = {name: seconds / calls[name] for name, seconds in times.items()}
    return [
        Row(
            name,
            f"{1e6 * one:.0f} us, {one / unit:.2f} transforms",
            against,
            f"{one / each[against]:.2f}x its time",
            one / unit,
        )
        for name, one in each.items()
    ]


def field_rows() -> list[Row]:
    """Ten features of 500x500 in fields, eight frames a call."""
    features = VisualFeatures()
    frames = torch.randint(0, 256, (8, 3, 500, 500), dtype=torch.uint8)
    jobs: dict[str, Callable[[], object]] = {"ten features, whole field": lambda: features(frames)}
    for grid in GRIDS:
        local = LocalFeatures(features, grid)
        jobs[f"ten features, {grid}x{grid} fields"] = lambda job=local: job(frames)
    return measured(jobs, dict.fromkeys(jobs, 8), "ten features, whole field")


def neuron_rows() -> list[Row]:
    """A learning network, delayed feedback and settled, a step."""
    jobs: dict[str, Callable[[], object]] = {}
    for feedback in ("delayed", "settled"):
        for neurons in NEURONS:
            make = InhibitoryNetwork if feedback == "delayed" else InhibitoryNetwork.scale_free
            network, inputs = make(neurons, settle=0.0), torch.rand(STEPS, neurons)
            jobs[f"network of {neurons} neurons, {feedback}"] = lambda n=network, x=inputs: n(x)
    return measured(jobs, dict.fromkeys(jobs, STEPS), "network of 10 neurons, delayed")


def feature_rows() -> list[Row]:
    """Steps of the published controller, with so many features of the rows to take ranges of."""
    jobs: dict[str, Callable[[], object]] = {}
    left, right = (torch.from_numpy(x).permute(2, 0, 1)[None] for x in stereo_pair(1))
    for count in FOUND:
        navigator = Navigator(StereoRig(), DT, controller="published", features=FeatureParams(count))
        jobs[f"navigation step, {count} features"] = Again(navigator, left, right)
    return measured(jobs, dict.fromkeys(jobs, 1), f"navigation step, {FOUND[0]} features")


class Again:
    """The next step of a navigator at every call."""

    def __init__(self, navigator: Navigator, left: torch.Tensor, right: torch.Tensor) -> None:
        self.navigator, self.frames, self.state = navigator, (left, right), None

    def __call__(self) -> None:
        _, self.state = self.navigator(*self.frames, self.state)


def convolution_rows() -> list[Row]:
    """The orientation of a 500x500 frame: its sums, its images by transforms, and those images by `conv2d`."""
    fast, exact = OrientedDoG((500, 500)), OrientedDoG((500, 500), exact=True)
    image, half = torch.rand(1, 500, 500), 88
    # The filters themselves, out to four of their largest deviations.
    dot = torch.zeros(1, 500, 500)
    dot[0, 250, 250] = 1
    kernels = exact.images(dot)[0, :, 250 - half : 251 + half, 250 - half : 251 + half].flip(-1, -2).unsqueeze(1)
    padded = F.pad(image.unsqueeze(0), (half,) * 4, mode="circular")
    apart = (F.conv2d(padded, kernels)[0] - exact.images(image)[0]).abs().max() / exact.images(image).abs().max()
    assert apart < 0.02, f"conv2d gives other images: {apart:.3f}"
    jobs: dict[str, Callable[[], object]] = {
        "orientation of 500x500, sums": lambda: fast.sums(image),
        "orientation of 500x500, images": lambda: exact.images(image),
        "orientation of 500x500, images by torch conv2d": lambda: F.conv2d(padded, kernels),
    }
    return measured(jobs, dict.fromkeys(jobs, 1), "orientation of 500x500, sums")


def frames_done(seconds: float) -> int:
    """Frames of 500x500 until so much time of the clock has passed."""
    features, frames = VisualFeatures(), torch.randint(0, 256, (8, 3, 500, 500), dtype=torch.uint8)
    with torch.inference_mode():
        _, state = features(frames)
        print("ready", flush=True)
        sys.stdin.readline()
        done, end = 0, time.perf_counter() + seconds
        while time.perf_counter() < end:
            features(frames, state)
            done += len(frames)
    return done


def by_processes(count: int) -> int:
    """Frames that so many processes do together, one thread each."""
    command = [sys.executable, "-m", "tests.benchmarks.bench_sizes", "--one"]
    running = [
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) for _ in range(count)
    ]
    for process in running:
        assert process.stdout is not None
        process.stdout.readline()
    for process in running:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    return sum(int(process.communicate()[0]) for process in running)


def main() -> None:
    torch.set_num_threads(1)
    if sys.argv[1:] == ["--one"]:
        print(frames_done(SECONDS))
        return
    found = rows()
    for more in (field_rows, neuron_rows, feature_rows, convolution_rows):
        found += more()
    if sys.argv[1:] == ["--two"]:
        pairs = [(by_processes(1), by_processes(2)) for _ in range(3)]
        for one, two in pairs:
            found.append(Row("two processes", f"{two / SECONDS:.0f} frames/s", "one process", f"{two / one:.2f}x"))
    print(table("Sizes", found))


if __name__ == "__main__":
    main()
