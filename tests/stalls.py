"""Notes when the machine itself stalls, and runs a real-time test again that failed.

The meter is a process of its own, so that no test can keep it from waking. It has one thread on each processor, more
important than everything under test. A thread sleeps a few milliseconds and notes how late it woke.
`python tests/stalls.py FILE` is the meter; it ends with its standard input.
"""

import contextlib
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

STEP = 0.005
NOTED = 0.001
"""Waking later than this is written down, s."""

STALL = 0.06
"""From here on the machine stalled: a car whose wheels must stand within 0.25 s cannot be timed on it."""

PRIORITY = 20
"""Above the loop (3) and the simulated board (5), which therefore cannot delay the meter."""

WINDOW = 0.25
"""Several short stalls of one processor within this time count together, s: the wheels must stand within it."""

ATTEMPTS = 3

FAILURES = 2
"""Failures that count: on a machine that others use, one late moment that the meter cannot see (a disk, a driver) is no
proof that the car is slow. What failed once and then went well is named at the end of the run."""

PATIENCE = 150.0
"""Seconds for all further attempts of all tests: on a machine that stalls all the time nobody waits for ever."""

OTHERS: list[tuple[float, float]] = []
"""Stalls seen by others than the meter: when they ended, and seconds."""


class StallMeter:
    """The running meter. Worst of all stalls since some moment, and how punctual waking was."""

    def __init__(self):
        self.folder = tempfile.TemporaryDirectory(prefix="stalls-")
        self.file = Path(self.folder.name) / "late"
        command = [sys.executable, "-I", "-S", __file__, str(self.file)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, start_new_session=True)
        end = time.monotonic() + 10.0
        while not self.file.exists():
            if time.monotonic() > end or self.process.poll() is not None:
                raise RuntimeError("the stall meter does not start")
            time.sleep(0.01)

    def late(self, since):
        """When a thread woke late, how late, s, and on which processor, each time it did so since then."""
        text = self.file.read_text()
        lines = [line.split() for line in text[: text.rfind("\n") + 1].splitlines()]
        woken = [(float(when), float(seconds), int(cpu)) for when, seconds, cpu in lines]
        return [one for one in woken if one[0] > since]

    def worst(self, since):
        """The most that a processor lost within a moment that ended since then, s."""
        time.sleep(0.1)  # until a stall that lasts has been noted
        return max(lost(self.late(since)), *(seconds for when, seconds in OTHERS if when > since), 0.0)

    def close(self):
        self.process.stdin.close()
        try:
            self.process.wait(3.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.folder.cleanup()


def lost(woken):
    """The most that one processor lost within `WINDOW`, s, of times when it woke, how late, and which it was."""
    worst = 0.0
    for cpu in {one[2] for one in woken}:
        ours = [(when, late) for when, late, which in woken if which == cpu]
        for end, _ in ours:
            worst = max(worst, sum(late for when, late in ours if end - WINDOW < when <= end))
    return worst


class Again:
    """Runs what failed again, up to three times in all, while patience lasts.

    A failure while the machine stalled does not count. Two others do.

    Args:
        worst_since: the longest stall that ended after a given time, s.
    """

    def __init__(self, worst_since):
        self.worst_since, self.patience = worst_since, PATIENCE

    def run(self, work):
        """Call `work`, which returns whether it went well, until it did, or failed twice without a stall.

        Returns what counts, True or False, or None when an attempt too many fell into a stall; and the longest stall in
        each attempt that failed before the last one, s.
        """
        stalls, failures = [], 0
        for attempt in range(ATTEMPTS):
            began = time.monotonic()
            if work():
                return True, stalls
            worst = self.worst_since(began)
            failures += worst < STALL
            if failures == FAILURES:
                return False, stalls
            stalls.append(worst)
            self.patience -= (time.monotonic() - began) if attempt else 0.0
            if self.patience < 0:
                break
        return None, stalls


def measure(cpu, file):
    """Sleep and note, for ever, on one processor."""
    with contextlib.suppress(OSError):
        os.sched_setaffinity(0, {cpu})
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))
    while True:
        due = time.monotonic() + STEP
        time.sleep(STEP)
        now = time.monotonic()
        if now - due > NOTED:
            file.write(f"{now:.4f} {now - due:.4f} {cpu}\n")


def main(path):
    with Path(path).open("w", buffering=1) as file:
        for cpu in sorted(os.sched_getaffinity(0)):
            threading.Thread(target=measure, args=(cpu, file), daemon=True).start()
        sys.stdin.read()
        os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1])
