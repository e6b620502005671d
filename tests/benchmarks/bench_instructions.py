"""How many instructions a call of the hottest kernels takes: a figure that no other load on the machine changes.

`python -m tests.benchmarks.bench_instructions`, some minutes. It needs valgrind. What each kernel was called with is
kept, and a process without torch then calls them with it, 20 times each, under valgrind's callgrind. That is from
Python's call to its result. Valgrind knows no vectors of 512 bits, so kernels are compiled for processors with AVX2
(`haswell`) here.
"""

from __future__ import annotations

import os
import pickle
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ndtorch.kernels.load import Kernel, kernel
from ndtorch.navigation import Avoider, GridMap, Navigator, StereoRig
from ndtorch.vision import VisualFeatures
from tests.benchmarks.bench_navigation import DT, EDGES, stereo_pair
from tests.benchmarks.timing import Row, machine, table

TITLE = "Instructions"
PROCESSOR = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": ""}
CALLS = 20
STEPS = 60
MARK = "getppid"
"""A function of the system that nothing else calls: callgrind writes its counts down whenever it is called."""

ALONE = f"""
import os, pickle, sys
from ndtorch.kernels.load import kernel
for name, given in pickle.load(open(sys.argv[1], "rb")).items():
    given = pickle.loads(given)
    run = kernel(name).run
    run(*given)
    run = kernel(name).run
    os.{MARK}()
    for _ in range({CALLS}):
        run(*given)
    os.{MARK}()
assert "torch" not in sys.modules
"""


def given_to(kernels: list[str], work: Any) -> dict[str, bytes]:
    """What each of these kernels was last called with while `work` ran, pickled before the call."""
    kept: dict[str, bytes] = {}
    usual = Kernel.first

    def first(self: Kernel, *given: Any) -> Any:
        def run(*given: Any) -> Any:
            kept[self.name] = pickle.dumps(given)
            return self.dispatcher(*given)

        if self.name in kernels:
            self.run = run
            return run(*given)
        return usual(self, *given)

    # So that each is asked for anew.
    kernel.cache_clear()
    Kernel.first = first  # type: ignore[method-assign]
    try:
        with torch.inference_mode():
            work()
    finally:
        Kernel.first = usual  # type: ignore[method-assign]
        kernel.cache_clear()
    return kept


def drive(controller: str) -> None:
    """A navigator with a map, two cameras of 640x480."""
    navigator = Navigator(StereoRig(), DT, controller=controller, features=EDGES, grid_map=GridMap(StereoRig()))
    state = None
    for step in range(STEPS):
        left, right = (torch.from_numpy(x).permute(2, 0, 1)[None] for x in stereo_pair(step))
        _, state = navigator(left, right, state)


def avoid() -> None:
    """Avoidance alone."""
    avoider, state = Avoider(StereoRig(), DT), None
    for step in range(STEPS):
        _, state = avoider(*stereo_pair(step), state)


def look() -> None:
    """Ten features of eight frames."""
    frames = np.random.default_rng(0).integers(0, 256, (8, 3, 500, 500), dtype=np.uint8)
    features, state = VisualFeatures(), None
    for _ in range(2):
        _, state = features(torch.from_numpy(frames), state)


def counted(kept: dict[str, bytes]) -> dict[str, float]:
    """Instructions of one call of each."""
    with tempfile.TemporaryDirectory() as folder:
        given = Path(folder) / "given"
        given.write_bytes(pickle.dumps(kept))
        env = {**os.environ, **PROCESSOR, "XDG_CACHE_HOME": folder}
        plain = [sys.executable, "-c", ALONE, str(given)]
        # Compiled and kept before valgrind looks on.
        subprocess.run(plain, env=env, check=True)
        out = Path(folder) / "counts"
        watched = ["valgrind", "-q", "--tool=callgrind", f"--dump-before={MARK}", f"--callgrind-out-file={out}", *plain]
        subprocess.run(watched, env=env, check=True)
        # Two dumps for each kernel: what was done until its calls began, and the calls.
        dumps = [totals(Path(f"{out}.{number}")) for number in range(1, 2 * len(kept) + 1)]
    return {name: dumps[2 * index + 1] / CALLS for index, name in enumerate(kept)}


def totals(dump: Path) -> int:
    """What callgrind counted since the dump before."""
    for line in dump.read_text().splitlines():
        if line.startswith(("summary:", "totals:")):
            return int(line.split()[1])
    raise RuntimeError(f"{dump}: no sum of instructions in it")


def rows() -> list[Row]:
    """Of each kernel, beside the one of avoidance."""
    kept = given_to(["avoid"], avoid) | given_to(["front_end"], look)
    kept |= given_to(["published_step", "beam_cells"], lambda: drive("published"))
    kept |= given_to(["ranging_step"], lambda: drive("ranging"))
    found = counted(kept)
    least = found["avoid"]
    return [Row(f"`{name}`", f"{n:,.0f}", "`avoid`", f"{n / least:.1f}x") for name, n in found.items()]


if __name__ == "__main__":
    if shutil.which("valgrind") is None:
        sys.exit("this needs valgrind, which Debian and Ubuntu have as a package of that name")
    print(f"{machine()}, {PROCESSOR['NUMBA_CPU_NAME']}\n")
    print(table(TITLE, rows()))
