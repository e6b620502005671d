"""Processes that work through a list of tasks; one that dies is replaced, and its task is given to another."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any, Literal, NamedTuple

from ndtorch.errors import InputError

TRIES = 3
"""How often a task is begun before it is given up: one that kills its worker would do so for ever."""

Report = Callable[[float], None]
"""Called by a task with the share of it that is done."""


class Event(NamedTuple):
    """What happened to a task.

    Attributes:
        kind: "progress" (value: share done), "done" (value: what the function returned), "again" (its worker
            died and it goes back into the queue; value: how it died), or "failed" (value: why).
        task: its number.
        value: see `kind`.
    """

    kind: Literal["progress", "done", "again", "failed"]
    task: int
    value: Any


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def exit_words(code: int | None) -> str:
    """What an exit code of a process means: `"SIGKILL"`, `"exit code 7"`."""
    if code is not None and code < 0:
        return signal.Signals(-code).name
    return f"exit code {code}"


def run_tasks(function: Callable[[Any, Report], Any], tasks: Sequence[Any], jobs: int) -> Generator[Event, None, None]:
    """Call `function(task, report)` for every task in `jobs` processes, in order, and tell what happens.

    The processes are started afresh (spawn), because a fork of a process that has used torch or OpenGL may hang, and
    compute with one thread. They end with the iterator, also when it is left early. The function is one of a module's
    top level, and tasks can be pickled.
    """
    if jobs < 1:
        raise InputError(f"jobs must be at least 1, got {jobs}")
    pool = _Pool(function, tasks)
    try:
        yield from pool.run(min(jobs, len(tasks)))
    finally:
        pool.end()


FOR_THE_GIVER = (signal.SIGINT, *((signal.SIGHUP,) if hasattr(signal, "SIGHUP") else ()))
"""Signals of a terminal that are for the process that gives the tasks, not for its workers."""


@contextlib.contextmanager
def blocked(signals: Sequence[int]) -> Iterator[None]:
    """A process that is started inside never sees these signals, not even while it imports what it works with.

    Here they come when the block has ended.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # It is started with the first process, and would let them through.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Worker:
    """A process, the pipe to it, and the number of the task it has."""

    def __init__(self, function: Callable[[Any, Report], Any]) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, function), daemon=True)
        with blocked(FOR_THE_GIVER):
            self.process.start()
        theirs.close()
        self.index: int | None = None


class _Pool:
    def __init__(self, function: Callable[[Any, Report], Any], tasks: Sequence[Any]) -> None:
        self.function, self.tasks = function, tasks
        self.waiting = deque(range(len(tasks)))
        self.begun = [0] * len(tasks)
        self.workers: list[_Worker] = []

    def run(self, jobs: int) -> Iterator[Event]:
        for _ in range(jobs):
            self.hire()
        while any(worker.index is not None for worker in self.workers):
            ready = wait([worker.pipe for worker in self.workers if worker.index is not None])
            for worker in [w for w in self.workers if w.pipe in ready]:
                yield from self.listen(worker)

    def hire(self) -> None:
        """One more worker, if there is work."""
        if self.waiting:
            worker = _Worker(self.function)
            self.workers.append(worker)
            self.give(worker)

    def give(self, worker: _Worker) -> None:
        """Hand out the next task."""
        worker.index = None
        if self.waiting:
            worker.index = self.waiting.popleft()
            self.begun[worker.index] += 1
            # A worker that is dead already is noticed when it is listened to.
            with contextlib.suppress(OSError):
                worker.pipe.send((worker.index, self.tasks[worker.index]))

    def listen(self, worker: _Worker) -> Iterator[Event]:
        index = worker.index
        assert index is not None
        try:
            kind, value = worker.pipe.recv()
        except (EOFError, OSError):
            worker.process.join()
            self.workers.remove(worker)
            if self.begun[index] < TRIES:
                self.waiting.append(index)
                yield Event("again", index, exit_words(worker.process.exitcode))
            else:
                words = f"its worker died {TRIES} times, at last with {exit_words(worker.process.exitcode)}"
                yield Event("failed", index, words)
            self.hire()
            return
        if kind != "progress":
            self.give(worker)
        yield Event(kind, index, value)

    def end(self) -> None:
        """Stop everybody, busy or not."""
        for worker in self.workers:
            if worker.index is None:
                with contextlib.suppress(OSError):
                    worker.pipe.send(None)
            else:
                worker.process.terminate()
        for worker in self.workers:
            worker.process.join(5)
            if worker.process.is_alive():
                worker.process.kill()
            worker.pipe.close()


def one_thread() -> None:
    """Compute with one thread. Torch takes two seconds to import: a worker whose tasks need none does not wait."""
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)
    else:
        os.environ["OMP_NUM_THREADS"] = os.environ["MKL_NUM_THREADS"] = "1"


def _serve(pipe: Connection, function: Callable[[Any, Report], Any]) -> None:
    """What a worker does: take tasks until there are no more, or until whoever gives them is gone."""
    for ending in FOR_THE_GIVER:
        signal.signal(ending, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # that is how it ends a worker
    one_thread()
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while (item := pipe.recv()) is not None:
            _, task = item

            def report(share: float) -> None:
                pipe.send(("progress", share))

            try:
                answer = ("done", function(task, report))
            except (BrokenPipeError, ConnectionResetError):
                return
            except InputError as error:
                answer = ("failed", str(error))
            except Exception:
                answer = ("failed", traceback.format_exc())
            pipe.send(answer)
