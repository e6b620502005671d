"""How long a navigator, or a model that binds, waits for its kernels: compiled once, and loaded.

`python -m tests.benchmarks.bench_start`, or with the names of controllers and models.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile

from tests.benchmarks.timing import Row, table

TITLE = "First start"
NAMES = ("published", "ranging", "ranging, near check", "goal, near check", "bind, foreground")
"""With the near check as `ndtorch drive` has them: they look at what is near, and search for what stands."""

STEP = """
import sys, time
import ndtorch, torch
from ndtorch.navigation import Navigator, StereoRig
from tests.benchmarks.timing import in_turn, reference
name, *more = sys.argv[1].split(", ")
if name == "bind":
    model = ndtorch.load(more[0], size=(240, 320))
    frames = torch.randint(60, 90, (1, 3, 240, 320), dtype=torch.uint8).repeat(60, 1, 1, 1)
    for t in range(15, 60):
        frames[t, :, 100:140, 4 * t : 4 * t + 40] = 200
    start = time.thread_time()
    model.objects(model(frames)[1])
else:
    navigator = Navigator(StereoRig(), 1 / 30, controller=name, near_check=bool(more))
    start = time.thread_time()
    navigator.warm_up()
taken = time.thread_time() - start
print(taken, taken / in_turn({"reference": reference})["reference"])
"""


def waits(name: str, folder: str) -> tuple[float, float]:
    """Seconds of the processor until the first fast step is done, and over `reference`, in a new process."""
    env = {**os.environ, "XDG_CACHE_HOME": folder, "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    ask = [sys.executable, "-c", STEP, name]
    said = subprocess.run(ask, env=env, capture_output=True, text=True, check=True)
    seconds, cost = map(float, said.stdout.split())
    return seconds, cost


def rows(device: str | None = None) -> list[Row]:
    """Of controllers and models."""
    return [row for name in NAMES for row in start_of(name)]


def start_of(name: str) -> list[Row]:
    """First with an empty cache, then with what that left."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for done, turns in (("compiled", 1), ("loaded", 3)):
            seconds, cost = min(waits(name, folder) for _ in range(turns))
            found.append(Row(f"{name}, {done}", f"{seconds:.2f} s", "", "", cost))
    return found


if __name__ == "__main__":
    print(table(TITLE, [row for name in sys.argv[1:] or NAMES for row in start_of(name)]))
