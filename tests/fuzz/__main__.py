"""`make fuzz MINUTES=10`: damaged files for everything that reads one.

Whatever a file holds, it is read, or refused by an `InputError` of one line. A traceback, a crash, a hang or a
gigabyte of memory is a finding: the file is kept under `out/fuzz`, and the exit code is 1.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
import time
from pathlib import Path

from tests.fuzz.targets import TARGETS
from tests.fuzz.worker import Worker

SLOW = ("torch", "cv2", "pydantic", "pyarrow.parquet", "ndtorch.binding", "ndtorch.navigation")


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument(
        "--seed", type=int, default=1, help="the inputs are drawn by it: the same seed, the same inputs"
    )
    parser.add_argument("--only", nargs="*", default=list(TARGETS), choices=list(TARGETS), help="these readers")
    parser.add_argument("--out", type=Path, default=Path("out/fuzz"), help="where findings are kept")
    given = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    for slow in SLOW:  # imported once, not by every process
        importlib.import_module(slow)
    end = time.monotonic() + 60 * given.minutes
    workers = {name: Worker(TARGETS[name], given.seed, given.out) for name in given.only}
    seconds = min(60.0, max(2.0, 60 * given.minutes / len(workers) / 2))
    while time.monotonic() < end:
        for worker in workers.values():
            worker.work(min(seconds, max(0.1, end - time.monotonic())))
            if time.monotonic() >= end:
                break
    print(f"{'reader':12} {'tried':>8} {'read':>8} {'refused':>8} {'findings':>8}")
    for name, worker in workers.items():
        print(f"{name:12} {worker.tried:8} {worker.read:8} {worker.refused:8} {len(worker.findings):8}")
    findings = [line for worker in workers.values() for line in worker.findings.values()]
    print(f"{sum(worker.tried for worker in workers.values())} inputs, {len(findings)} findings, seed {given.seed}")
    print("\n".join(findings))
    return bool(findings)


if __name__ == "__main__":
    sys.exit(main())
