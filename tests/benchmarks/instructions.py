"""Processor instructions of a step, counted by Valgrind: they depend on neither load nor clock.

`python -m tests.benchmarks.instructions` needs Debian's valgrind. All code is compiled for one processor (AVX2), so
that figures of different machines can be compared.
"""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import torch

from ndtorch.navigation import GridMap, Navigator, StereoRig
from ndtorch.scenes import two_bars
from ndtorch.vision import VisualFeatures
from tests.benchmarks.bench_navigation import DT, stereo_pair
from tests.benchmarks.timing import Row, table

TITLE = "Instructions of a step"
STEPS = 20
PROCESSOR = {
    "NUMBA_CPU_NAME": "haswell",
    "NUMBA_CPU_FEATURES": "+avx,+avx2,+fma,+f16c,+bmi,+bmi2,+lzcnt,+popcnt,+sse4.2",
    "ATEN_CPU_CAPABILITY": "avx2",
    "MKL_ENABLE_INSTRUCTIONS": "AVX2",
    "PYTHONHASHSEED": "0",
    "OMP_NUM_THREADS": "1",
}
SWITCH = """#include <valgrind/callgrind.h>
void on(void) { CALLGRIND_START_INSTRUMENTATION; }
void off(void) { CALLGRIND_STOP_INSTRUMENTATION; }
"""


Step = Callable[[int], object]


def navigator(controller: str) -> Step:
    """A step from two 640x480 RGB frames to the command, and the map."""
    rig = StereoRig()
    pairs = [[torch.from_numpy(image).permute(2, 0, 1).contiguous() for image in stereo_pair(n)] for n in range(3)]
    navigate, state = Navigator(rig, DT, controller=controller, grid_map=GridMap(rig)), None

    def step(n: int) -> None:
        nonlocal state
        _, state = navigate(*(eye[None] for eye in pairs[n % 3]), state)

    return step


def features() -> Step:
    """The ten features of a 500x500 frame."""
    frames, extract, state = torch.cat(list(two_bars(seconds=0.4).chunks(8))), VisualFeatures(), None

    def step(n: int) -> None:
        nonlocal state
        _, state = extract(frames[n % 30 : n % 30 + 1], state)

    return step


JOBS: dict[str, Callable[[], Step]] = {
    "ten features, 500x500": features,
    "`published` with map": partial(navigator, "published"),
    "`ranging` with map": partial(navigator, "ranging"),
}


def count(name: str) -> int:
    """Instructions of one step of a job, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        switch = Path(folder) / "switch.so"
        subprocess.run(["cc", "-shared", "-fPIC", "-x", "c", "-", "-o", switch], input=SWITCH, text=True, check=True)
        environment = os.environ | PROCESSOR
        job = [sys.executable, "-m", "tests.benchmarks.instructions", name, str(switch)]
        subprocess.run(job, env=environment, check=True)  # compiles, where the cache has nothing
        valgrind = ["valgrind", "--tool=callgrind", "--instr-atstart=no", "--smc-check=all-non-file"]
        valgrind += [f"--callgrind-out-file={folder}/out"]
        said = subprocess.run([*valgrind, *job], env=environment, check=True, capture_output=True, text=True).stderr
    collected = re.search(r"Collected : (\d+)", said)
    assert collected is not None, said
    return int(collected[1]) // STEPS


def rows(device: str | None = None) -> list[Row]:
    """None where Valgrind is not installed."""
    if not (shutil.which("valgrind") and shutil.which("cc")):
        return []
    counts = {name: count(name) for name in JOBS}
    return [Row(name, f"{number / 1e6:.2f} million", "", "", float(number)) for name, number in counts.items()]


def run(name: str, switch: str) -> None:
    """What is counted: `STEPS` steps after as many others."""
    torch.set_num_threads(1)
    library = ctypes.CDLL(switch)
    with torch.inference_mode():
        step = JOBS[name]()
        for n in range(2 * STEPS):
            if n == STEPS:
                library.on()
            step(n)
        library.off()


if __name__ == "__main__":
    if len(sys.argv) > 2:
        run(*sys.argv[1:3])
    else:
        print(table(TITLE, rows()))
