"""A flame graph of a bind or of a simulated drive: which function called which, as wide as the time it took.

`python -m tests.benchmarks.flame (bind | drive) PICTURE.png [SECONDS]`

Time is that of the processor. A drive is one of the `ranging` controller through the hallway. Both run
once before, to be warm.
"""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

import torch

EVERY = 0.0005
"""Seconds between two looks, of the clock: a timer of the processor's time looks every 4 ms only."""

THINNEST = 0.004
"""Share of the whole below which nothing is drawn."""


PLUMBING = ("_wrapped_call_impl", "_call_impl", "<listcomp>", "<lambda>", "decorate_context")
"""Functions that only call another one."""


@dataclass
class Call:
    """A function as called from one place.

    Attributes:
        seconds: in it and in all that it called.
        calls: what it called, by name.
    """

    seconds: float = 0.0
    calls: dict[str, Call] = field(default_factory=dict)


def grown(samples: Iterable[tuple[tuple[str, ...], float]]) -> Call:
    """The tree of stacks, outermost function first, and the seconds that each was seen."""
    root = Call()
    for stack, seconds in samples:
        call = root
        call.seconds += seconds
        for name in stack:
            call = call.calls.setdefault(name, Call())
            call.seconds += seconds
    return root


def sampled(job: Callable[[], object]) -> Call:
    """What a job spends its time on.

    A look waits for the end of a call into C. So it counts all the time since the look before.
    """
    samples: list[tuple[tuple[str, ...], float]] = []
    last = time.thread_time()

    def look(_: int, frame: FrameType | None) -> None:
        nonlocal last
        stack: list[str] = []
        while frame is not None and frame.f_code is not sampled.__code__:
            if frame.f_code is not look.__code__ and frame.f_code.co_name not in PLUMBING:
                stack.append(f"{frame.f_globals.get('__name__', '?').rpartition('.')[2]}.{frame.f_code.co_qualname}")
            frame = frame.f_back
        now = time.thread_time()
        samples.append((tuple(reversed(stack)), now - last))
        last = now

    before = signal.signal(signal.SIGALRM, look)
    signal.setitimer(signal.ITIMER_REAL, EVERY, EVERY)
    try:
        job()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    return grown(samples)


def draw(root: Call, title: str, path: Path) -> None:
    """The outermost function above, what it calls below it."""
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14, 8))
    axes = figure.add_axes((0.01, 0.01, 0.98, 0.93))
    deepest = 1

    def row(call: Call, left: float, depth: int) -> None:
        nonlocal deepest
        for name, inner in sorted(call.calls.items(), key=lambda item: -item[1].seconds):
            wide = inner.seconds / root.seconds
            if wide >= THINNEST:
                deepest = max(deepest, depth + 1)
                color = colormaps["YlOrBr"](0.15 + 0.5 * (hash_of(name) % 97) / 97)
                axes.barh(depth, wide, 0.94, left, color=color, edgecolor="white", linewidth=0.5)
                room = int(wide * 190)
                words = f"{'.'.join(name.split('.')[-2:])} {100 * wide:.0f} %"
                if len(words) <= room or room > 6:
                    axes.text(left + 0.002, depth, words[:room], va="center", fontsize=7, clip_on=True)
                row(inner, left, depth + 1)
            left += wide

    row(root, 0.0, 0)
    axes.set(xlim=(0, 1), ylim=(deepest - 0.5, -0.6))
    axes.axis("off")
    figure.suptitle(f"{title}: {root.seconds:.1f} s of the processor", fontsize=10, y=0.98)
    figure.savefig(path, dpi=80)


def hash_of(name: str) -> int:
    """A number that is the same in every process."""
    return sum((k + 1) * ord(letter) for k, letter in enumerate(name))


def bind(seconds: float) -> None:
    """Two bars, from stimulus to table."""
    import ndtorch
    from ndtorch.run.run import run_model
    from ndtorch.scenes import two_bars

    run_model(ndtorch.load("published"), two_bars(seconds=seconds))


def drive(seconds: float) -> None:
    """A drive through the hallway."""
    from ndtorch_robot import drive as drives

    drives.drive(drives.DriveConfig(arena="hallway", controller="ranging", seconds=seconds))


def main() -> None:
    jobs, asked = {"bind": bind, "drive": drive}, sys.argv[1:]
    if len(asked) not in (2, 3) or asked[0] not in jobs:
        sys.exit(__doc__)
    torch.set_num_threads(1)
    job, seconds = jobs[asked[0]], float(asked[2]) if len(asked) > 2 else 15.0
    job(2.0)
    draw(sampled(lambda: job(seconds)), f"{asked[0]}, {seconds:g} s", Path(asked[1]))


if __name__ == "__main__":
    main()
