"""Processes that work through a list of tasks."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
import traceback
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import resource_tracker
from typing import Any, Literal, NamedTuple

from ndtorch.errors import InputError
from ndtorch.utils.signals import ENDING


class Event(NamedTuple):
    """What became of a task: "done" (value: what the function returned) or "failed" (value: why)."""

    kind: Literal["done", "failed"]
    task: int
    value: Any


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_tasks(function: Callable[[Any], Any], tasks: Sequence[Any], jobs: int) -> Generator[Event, None, None]:
    """Call `function(task)` for every task in `jobs` processes, in order, and tell what became of each.

    The processes are started afresh (spawn), because a fork of a process that has used torch may hang, and compute with
    one thread. They end with the iterator, also when it is left early. The function is one of a module's top level, and
    tasks can be pickled. Where a process dies, all unfinished tasks fail.
    """
    if jobs < 1:
        raise InputError(f"jobs must be at least 1, got {jobs}")
    if not tasks:
        return
    pool = ProcessPoolExecutor(min(jobs, len(tasks)), multiprocessing.get_context("spawn"), one_thread)
    # Signals of a terminal are for this process: a worker never sees them, not even while it imports.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING[::2])
    try:
        numbers = {pool.submit(function, task): number for number, task in enumerate(tasks)}
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    workers = multiprocessing.active_children()
    try:
        for future in as_completed(numbers):
            error = future.exception()
            if error is None:
                yield Event("done", numbers[future], future.result())
            elif isinstance(error, InputError | BrokenProcessPool):
                yield Event("failed", numbers[future], str(error))
            else:
                yield Event("failed", numbers[future], "".join(traceback.format_exception(error)))
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for worker in workers:
            worker.terminate()
        # The pool's thread waits for them too: where it was first, `join` returns before their end is noted.
        while any(worker.is_alive() for worker in workers):
            time.sleep(0.01)


def one_thread() -> None:
    """What a worker begins with."""
    os.environ["OMP_NUM_THREADS"] = os.environ["MKL_NUM_THREADS"] = "1"
