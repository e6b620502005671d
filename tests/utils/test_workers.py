"""Processes that work through tasks, and how they end."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time

from ndtorch.errors import InputError
from ndtorch.utils.workers import run_tasks


def task(item: tuple[str, str]) -> str:
    """Doubles, complains, breaks, dies or sleeps."""
    kind, value = item
    if kind == "refuse":
        raise InputError(f"no {value}")
    if kind == "break":
        raise RuntimeError(value)
    if kind == "die":
        os._exit(9)
    if kind == "sleep":
        time.sleep(600)
    if kind == "ctrl-c":
        os.kill(os.getpid(), signal.SIGINT)
    return value + value


def test_tasks_are_done_whatever_happens_to_others() -> None:
    tasks = [("ok", "a"), ("refuse", "b"), ("break", "c"), ("ctrl-c", "d")]
    ends = {number: (kind, value) for kind, number, value in run_tasks(task, tasks, 2)}
    assert ends.pop(2)[1].endswith("RuntimeError: c\n")
    assert ends == {0: ("done", "aa"), 1: ("failed", "no b"), 3: ("done", "dd")}
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
    assert not multiprocessing.active_children()


def test_a_worker_that_dies_ends_the_run() -> None:
    events = list(run_tasks(task, [("die", ""), ("sleep", "")], 1))
    assert {event.kind for event in events} == {"failed"}
    assert len(events) == 2


def test_leaving_early_ends_the_workers() -> None:
    events = run_tasks(task, [("ok", "a"), ("sleep", "")], 2)
    assert next(events).value == "aa"
    assert multiprocessing.active_children()
    events.close()
    assert not multiprocessing.active_children()
