"""How long a navigator waits for its kernels: compiled once, and loaded.

`python -m tests.benchmarks.bench_start`, or with the names of controllers.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile

from tests.benchmarks.timing import Row, table

TITLE = "Start of a navigator"
CONTROLLERS = ("published", "ranging", "ranging, near check")
"""The last as `ndtorch drive` has it: it looks at what is near, and searches for what stands."""

STEP = """
import sys, time
from ndtorch.navigation import Navigator, StereoRig
from tests.benchmarks.timing import in_turn, reference
name, *near = sys.argv[1].split(", ")
navigator = Navigator(StereoRig(), 1 / 30, controller=name, near_check=bool(near))
start = time.thread_time()
navigator.warm_up()
taken = time.thread_time() - start
print(taken, taken / in_turn({"reference": reference})["reference"])
"""


def waits(controller: str, folder: str) -> tuple[float, float]:
    """Seconds of the processor until the first fast step is done, and over `reference`, in a new process."""
    env = {**os.environ, "XDG_CACHE_HOME": folder, "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    ask = [sys.executable, "-c", STEP, controller]
    said = subprocess.run(ask, env=env, capture_output=True, text=True, check=True)
    seconds, cost = map(float, said.stdout.split())
    return seconds, cost


def rows(device: str | None = None) -> list[Row]:
    """Of both controllers, with the near check too."""
    return [row for controller in CONTROLLERS for row in start_of(controller)]


def start_of(controller: str) -> list[Row]:
    """First with an empty cache, then with what that left."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for done, turns in (("compiled", 1), ("loaded", 3)):
            seconds, cost = min(waits(controller, folder) for _ in range(turns))
            name, *near = controller.split(", ")
            found.append(Row(", ".join((f"step of `{name}`", *near, done)), f"{seconds:.2f} s", "", "", cost))
    return found


if __name__ == "__main__":
    print(table(TITLE, [row for name in sys.argv[1:] or CONTROLLERS for row in start_of(name)]))
