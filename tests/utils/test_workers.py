"""Processes that work through tasks, and how they and commands end."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time

from ndtorch.errors import InputError
from ndtorch.utils.workers import Report, run_tasks


def task(item: tuple[str, str], report: Report) -> str:
    """Doubles, complains, breaks or dies."""
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
        return str(signal.pthread_sigmask(signal.SIG_BLOCK, ()) >= {signal.SIGINT, signal.SIGHUP})
    if kind == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    report(0.5)
    return value + value


def test_tasks_are_done_whatever_happens_to_others() -> None:
    tasks = [("ok", "a"), ("refuse", "b"), ("break", "c"), ("die", ""), ("ok", "d")]
    events = list(run_tasks(task, tasks, 2))
    ends = {e.task: (e.kind, e.value) for e in events if e.kind in ("done", "failed")}
    assert sorted(ends) == list(range(5))
    assert ends[0] == ("done", "aa")
    assert ends[1] == ("failed", "no b")
    assert ends[2][0] == "failed"
    assert "RuntimeError: c" in ends[2][1]
    assert ends[3] == ("failed", "its worker died with exit code 9")
    assert ends[4] == ("done", "dd")
    assert ("progress", 0, 0.5) in [tuple(e) for e in events]
    assert not multiprocessing.active_children()


def test_ctrl_c_is_not_for_workers() -> None:
    """From the moment they are started on: they import for seconds, and would print a traceback each."""
    events = list(run_tasks(task, [("ctrl-c", "")], 1))
    assert [(e.kind, e.value) for e in events] == [("done", "True")]
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_leaving_early_ends_the_workers() -> None:
    events = run_tasks(task, [("ok", "a"), ("sleep", "")], 2)
    assert next(events).kind == "progress"
    assert multiprocessing.active_children()
    events.close()
    assert not multiprocessing.active_children()
