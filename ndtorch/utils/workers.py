"""Processes that work through a list of tasks; one that dies is replaced."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import traceback
from collections import deque
from collections.abc import Callable, Generator, Sequence
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any, Literal, NamedTuple

from ndtorch.errors import InputError
from ndtorch.utils.signals import ENDING

Report = Callable[[float], None]
"""Called by a task with the share of it that is done."""


class Event(NamedTuple):
    """What happened to a task.

    Attributes:
        kind: "progress" (value: share done), "done" (value: what the function returned) or "failed" (value: why).
        task: its number.
        value: see `kind`.
    """

    kind: Literal["progress", "done", "failed"]
    task: int
    value: Any


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_tasks(function: Callable[[Any, Report], Any], tasks: Sequence[Any], jobs: int) -> Generator[Event, None, None]:
    """Call `function(task, report)` for every task in `jobs` processes, in order, and tell what happens.

    The processes are started afresh (spawn), because a fork of a process that has used torch or OpenGL may hang, and
    compute with one thread. They end with the iterator, also when it is left early. The function is one of a module's
    top level, and tasks can be pickled.
    """
    if jobs < 1:
        raise InputError(f"jobs must be at least 1, got {jobs}")
    context, waiting = multiprocessing.get_context("spawn"), deque(range(len(tasks)))
    workers: dict[Any, tuple[Any, int]] = {}

    def give(pipe: Any, process: Any) -> None:
        index = waiting.popleft()
        workers[pipe] = process, index
        # A worker that is dead already is noticed when it is listened to.
        with contextlib.suppress(OSError):
            pipe.send(tasks[index])

    def hire() -> None:
        pipe, other_end = context.Pipe()
        process = context.Process(target=_serve, args=(other_end, function), daemon=True)
        # Signals of a terminal are for this process: a worker never sees them, not even while it imports.
        resource_tracker.ensure_running()
        before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING[::2])
        try:
            process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        other_end.close()
        give(pipe, process)

    def dismiss(pipe: Any) -> Any:
        process, _ = workers.pop(pipe)
        pipe.close()  # which a worker without a task takes as the end
        return process

    try:
        while waiting and len(workers) < jobs:
            hire()
        while workers:
            for pipe in list[Any](wait(list(workers))):
                process, index = workers[pipe]
                try:
                    kind, value = pipe.recv()
                except (EOFError, OSError):
                    dismiss(pipe).join()
                    code = process.exitcode
                    how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
                    kind, value = "failed", f"its worker died with {how}"
                    if waiting:
                        hire()
                else:
                    if kind != "progress" and waiting:
                        give(pipe, process)
                    elif kind != "progress":
                        dismiss(pipe).join()
                yield Event(kind, index, value)
    finally:
        for pipe in list(workers):
            process = dismiss(pipe)
            process.terminate()
            process.join(5)
            process.kill()
            process.join()


def _serve(pipe: Connection, function: Callable[[Any, Report], Any]) -> None:
    """What a worker does: take tasks until there are no more, or until whoever gives them is gone."""
    for ending in ENDING[::2]:
        signal.signal(ending, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # that is how it is ended
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)
    else:  # a worker whose tasks need none does not wait for it
        os.environ["OMP_NUM_THREADS"] = os.environ["MKL_NUM_THREADS"] = "1"
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            task = pipe.recv()
            try:
                answer = ("done", function(task, lambda share: pipe.send(("progress", share))))
            except (BrokenPipeError, ConnectionResetError):
                return
            except InputError as error:
                answer = ("failed", str(error))
            except Exception:
                answer = ("failed", traceback.format_exc())
            pipe.send(answer)
