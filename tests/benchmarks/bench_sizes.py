"""Ten features of frames of several sizes, and how much two processes do on two cores.

`python -m tests.benchmarks.bench_sizes [--two]`; `--two` wants a machine with nothing else to do: it goes by the clock.
"""

from __future__ import annotations

import subprocess
import sys
import time

import torch

from ndtorch.vision import VisualFeatures
from tests.benchmarks.timing import Row, in_turn, reference, table

SIZES = ((224, 398), (480, 640), (500, 500), (720, 1280), (1080, 1920))
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
    if sys.argv[1:] == ["--two"]:
        pairs = [(by_processes(1), by_processes(2)) for _ in range(3)]
        for one, two in pairs:
            found.append(Row("two processes", f"{two / SECONDS:.0f} frames/s", "one process", f"{two / one:.2f}x"))
    print(table("Sizes of frames", found))


if __name__ == "__main__":
    main()
