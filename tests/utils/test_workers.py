"""Processes that work through tasks, and how they and commands end."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ndtorch.errors import InputError
from ndtorch.utils.workers import TRIES, Report, run_tasks


def task(item: tuple[str, str], report: Report) -> str:
    """Squares, complains, breaks, or dies until a file says that it has died often enough."""
    kind, value = item
    if kind == "refuse":
        raise InputError(f"no {value}")
    if kind == "break":
        raise RuntimeError(value)
    if kind == "die":
        place, times = value.split(":")
        died = len(list(Path(place).iterdir()))
        if died < int(times):
            (Path(place) / str(died)).touch()
            os._exit(9)
        return f"after {died}"
    if kind == "sleep":
        time.sleep(600)
    if kind == "ctrl-c":
        os.kill(os.getpid(), signal.SIGINT)
        return str(signal.pthread_sigmask(signal.SIG_BLOCK, ()) >= {signal.SIGINT, signal.SIGHUP})
    if kind == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    report(0.5)
    return value + value


def test_tasks_are_done_whatever_happens_to_others(tmp_path: Path) -> None:
    always = tmp_path / "always"
    once = tmp_path / "once"
    always.mkdir()
    once.mkdir()
    tasks = [("ok", "a"), ("refuse", "b"), ("break", "c"), ("die", f"{once}:1"), ("die", f"{always}:99"), ("ok", "d")]
    events = list(run_tasks(task, tasks, 2))
    ends = {e.task: (e.kind, e.value) for e in events if e.kind in ("done", "failed")}
    assert sorted(ends) == list(range(6))
    assert ends[0] == ("done", "aa")
    assert ends[1] == ("failed", "no b")
    assert ends[2][0] == "failed"
    assert "RuntimeError: c" in ends[2][1]
    assert ends[3] == ("done", "after 1")
    assert ends[4] == ("failed", f"its worker died {TRIES} times, at last with exit code 9")
    assert ends[5] == ("done", "dd")
    assert sum(e.kind == "again" for e in events) == 1 + (TRIES - 1)
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


ROOT = Path(__file__).resolve().parents[2]

SWALLOWS = """
import os, signal
try:
    os.kill(os.getpid(), signal.{name})
    while True:  # a signal is handled between two steps
        pass
except BaseException:
    raise ImportError("something went wrong in C++") from None
"""
"""A module that is interrupted while it is being imported, and says that it was something else."""


def ended(program: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A program that finds modules in this folder first."""
    path = os.pathsep.join([str(folder), str(ROOT), str(ROOT / "robot"), str(ROOT / "train")])
    return subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_while_torch_is_being_imported(name: str, code: int, tmp_path: Path) -> None:
    """Whatever torch makes of an exception that is raised in the middle of it."""
    (tmp_path / "torch").mkdir()
    (tmp_path / "torch" / "__init__.py").write_text(SWALLOWS.format(name=name))
    words = ["ndtorch", "bind", "two-bars", "--out", str(tmp_path / "out")]
    done = ended(f"import sys; sys.argv = {words}; from ndtorch.__main__ import program; sys.exit(program())", tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (code, "", "stopped before there was anything to keep\n")
    assert not (tmp_path / "out").exists()
