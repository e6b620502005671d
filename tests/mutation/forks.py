"""`python forks.py MODULES...`: run pytest again and again, in children of one process that has imported what is slow.

Reads one JSON object a line: `arguments` for pytest, `cpu` and `wall`, the seconds that it may take. Answers with one:
`status`, None where it took too long, `failed`, the first test that did, None where no single one is known, and the
seconds of `cpu` and `wall` that it did take. Nothing of the project is imported before the fork, so every child sees
the sources as they are then.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import math
import os
import resource
import signal
import sys
import time
from collections.abc import Sequence
from typing import Any

MEMORY = 16 << 30
"""Bytes that a child may ask for: a change that asks for more is noticed, and nothing else on the machine."""


class First:
    """A plugin of pytest: the first test that fails is written to `pipe`.

    Args:
        pipe: file descriptor to write to; closed for the programs that tests begin.
    """

    def __init__(self, pipe: int) -> None:
        self.pipe: int | None = pipe

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Called by pytest after each part of a test."""
        if report.failed and self.pipe is not None:
            os.write(self.pipe, report.nodeid.encode()[:4000])  # less than a pipe holds: nobody reads before the end
            self.pipe = None


def child(arguments: Sequence[str], cpu: float, pipe: int) -> int:
    """In the child: the exit status of pytest."""
    limit = math.ceil(cpu)
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 5))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    silent = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(silent, stream)
    import pytest

    return int(pytest.main(list(arguments), plugins=[First(pipe)]))


def run(arguments: Sequence[str], cpu: float, wall: float) -> dict[str, Any]:
    """In a child of its own group, of which nothing is left afterwards."""
    began = time.monotonic()
    reading, writing = os.pipe()
    process = os.fork()
    if process == 0:
        status = 99
        try:
            os.setsid()
            os.close(reading)
            status = child(arguments, cpu, writing)
        finally:
            os._exit(status)
    os.close(writing)
    late = False
    try:
        while True:
            ended, code, usage = os.wait4(process, os.WNOHANG)
            if ended:
                break
            if time.monotonic() - began > wall:
                late = True
                os.kill(process, signal.SIGKILL)
                _, code, usage = os.wait4(process, 0)
                break
            time.sleep(0.02)
    finally:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process, signal.SIGKILL)
    os.set_blocking(reading, False)  # a grandchild that has left the group may hold the other end
    failed = b""
    with contextlib.suppress(BlockingIOError):
        failed = os.read(reading, 4096)
    os.close(reading)
    late = late or (os.WIFSIGNALED(code) and os.WTERMSIG(code) == signal.SIGXCPU)
    status = None if late else os.waitstatus_to_exitcode(code)
    cpu, first = usage.ru_utime + usage.ru_stime, failed.decode(errors="replace")
    return {"status": status, "cpu": cpu, "wall": time.monotonic() - began, "failed": first or None}


def main() -> None:
    """Until the input ends."""
    answers = os.fdopen(os.dup(1), "w")
    for module in sys.argv[1:]:
        with contextlib.suppress(ImportError):
            importlib.import_module(module)
    for line in sys.stdin:
        asked = json.loads(line)
        answers.write(json.dumps(run(asked["arguments"], asked["cpu"], asked["wall"])) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
