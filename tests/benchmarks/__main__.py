"""`make bench`: every timing, each beside what it is compared with, as tables in Markdown and as JSON."""

from __future__ import annotations

import argparse
import json
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import torch

from ndtorch.utils.tensors import tune_allocator
from tests.benchmarks import bench_binding, bench_features, bench_navigation
from tests.benchmarks.timing import machine, table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", help="also time this torch device, such as cuda", default=None)
    parser.add_argument("--json", type=Path, help="also write the figures here", default=None)
    asked = parser.parse_args()
    device, found = asked.device, []
    torch.set_num_threads(1)
    # As the command line does.
    tune_allocator()
    print(f"{machine(device)}\n")
    for bench in (bench_features, bench_binding, bench_navigation):
        rows = bench.rows(device)
        print(table(bench.TITLE, rows), flush=True)
        found += [{"table": bench.TITLE, **row._asdict()} for row in rows]
    if asked.json is not None:
        asked.json.parent.mkdir(parents=True, exist_ok=True)
        versions = {name: version(name) for name in ("ndtorch", "torch", "numpy", "numba") if find_spec(name)}
        words = {"machine": machine(device), "versions": versions, "rows": found}
        asked.json.write_text(json.dumps(words, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
