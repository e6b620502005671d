"""`make bench`: every timing, each beside what it is compared with, as tables in Markdown."""

from __future__ import annotations

import argparse

import torch

from ndtorch.memory import tune_allocator
from tests.benchmarks import bench_binding, bench_cameras, bench_features, bench_navigation
from tests.benchmarks.timing import machine, table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", help="also time this torch device, such as cuda", default=None)
    device = parser.parse_args().device
    torch.set_num_threads(1)
    # As the command line does.
    tune_allocator()
    print(f"{machine(device)}\n")
    for bench in (bench_features, bench_binding, bench_navigation, bench_cameras):
        print(table(bench.TITLE, bench.rows(device)))


if __name__ == "__main__":
    main()
