"""Jobs for a few worker processes, which may die without taking the others along."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Generator, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, NamedTuple

TRIES = 2
"""How often a job is begun before it is given up."""

Work = Callable[[Any, Callable[[float], None]], Any]
"""`work(job, progress) -> result`; a function of a module, called in a worker. `progress` takes any number."""


class Progress(NamedTuple):
    """What a job told of itself."""

    job: int
    made: float


class Done(NamedTuple):
    """A job is finished."""

    job: int
    result: Any


class Trouble(NamedTuple):
    """A job went wrong. It is tried once more unless `final`."""

    job: int
    reason: str
    final: bool


Event = Progress | Done | Trouble


class Worker(NamedTuple):
    """A process and the line to it."""

    process: BaseProcess
    line: Connection


def run_jobs(work: Work, jobs: Sequence[Any], processes: int) -> Generator[Event, None, None]:
    """Do the jobs in `processes` processes of their own and tell what happens.

    Processes are spawned, not forked, so that no thread or OpenGL context of this one is inherited. One that
    dies is replaced, and its job begun once more. Closing the generator, or Ctrl-C in it, ends all of them.
    """
    waiting = deque(range(len(jobs)))
    tries = [0] * len(jobs)
    busy: dict[Connection, tuple[Worker, int]] = {}
    idle: list[Worker] = []
    try:
        while waiting or busy:
            while waiting and len(busy) < processes:
                number = waiting.popleft()
                tries[number] += 1
                worker = idle.pop() if idle else start(work)
                worker.line.send(jobs[number])
                busy[worker.line] = (worker, number)
            for line in wait(list(busy)):
                assert isinstance(line, Connection)
                worker, number = busy[line]
                try:
                    kind, value = line.recv()
                except (EOFError, OSError):
                    worker.process.join()
                    kind, value = "died", f"its process died ({exit_words(worker.process.exitcode)})"
                if kind == "progress":
                    yield Progress(number, value)
                    continue
                del busy[line]
                if kind != "died":
                    idle.append(worker)
                if kind == "done":
                    yield Done(number, value)
                else:
                    final = kind == "unusable" or tries[number] >= TRIES
                    if not final:
                        waiting.append(number)
                    yield Trouble(number, value, final)
    finally:
        for worker in [*idle, *(worker for worker, _ in busy.values())]:
            worker.process.terminate()
            worker.process.join()


def start(work: Work) -> Worker:
    """A new process that waits for jobs."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=serve, args=(work, theirs), daemon=True)
    process.start()
    theirs.close()  # now only the worker holds that end, and its death shows at ours
    return Worker(process, ours)


def serve(work: Work, line: Connection) -> None:
    """Do jobs until the line closes. Runs in the worker."""
    from ndtorch.errors import InputError

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which then ends this process
    while True:
        try:
            job = line.recv()
        except EOFError:
            return
        try:
            result = work(job, lambda made: line.send(("progress", made)))
        except InputError as error:
            line.send(("unusable", str(error)))
        except Exception as error:  # whatever it is, the other jobs go on
            line.send(("failed", f"{type(error).__name__}: {error}"))
        else:
            line.send(("done", result))


def exit_words(code: int | None) -> str:
    """What an exit code of a process means."""
    if code is not None and code < 0:
        return signal.Signals(-code).name
    return f"exit code {code}"


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
