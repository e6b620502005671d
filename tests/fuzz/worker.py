"""A process that reads damaged files, and one that looks after it."""

from __future__ import annotations

import contextlib
import os
import random
import re
import resource
import select
import shutil
import signal
import struct
import tempfile
import time
import traceback
from pathlib import Path
from typing import Any

from ndtorch.errors import InputError
from tests.fuzz.targets import Target

SECONDS = 10.0
"""Of the processor for one input; more is a hang."""

STUCK = 300.0
"""Seconds without a word from the process that reads."""

MEMORY = 3 << 29
"""Bytes that a process may hold beyond what it held before: the largest picture allowed takes some hundred million."""

READ, REFUSED, FOUND = 0, 1, 2


class Hang(BaseException):
    """An input took too long."""


def attempt(target: Target, seed: int, number: int, folder: Path) -> tuple[int, str]:
    """Read the input of this number; what came of it, and a line about a finding."""
    path = target.make(random.Random(f"{seed} {target.name} {number}"), folder)
    try:
        target.read(path)
    except InputError as error:
        words = str(error).replace(str(folder), "")
        if "\n" in words or not words.strip():
            return FOUND, f"the message is not one line: {words!r}"
        if len(words) > 2000:
            return FOUND, f"the message has {len(words)} characters"
        return REFUSED, words
    except (Exception, Hang) as error:
        frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "/tests/" not in frame.filename]
        at = f"{Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else "?"
        ours = next((f"{Path(f.filename).name}:{f.lineno}" for f in reversed(frames) if "ndtorch" in f.filename), at)
        return FOUND, f"{type(error).__name__} at {ours}: {str(error).splitlines()[0][:200] if str(error) else ''}"
    return READ, ""


def hang(signum: int, frame: Any) -> None:
    raise Hang(f"more than {SECONDS:g} s of the processor")


def serve(target: Target, seed: int, first: int, seconds: float, answers: int) -> None:
    """In the child: input after input, one answer each."""
    silent = os.open(os.devnull, os.O_RDWR)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    signal.signal(signal.SIGPROF, hang)
    for seed_path in target.seeds():  # whatever is imported or compiled for the first time is so now
        with contextlib.suppress(InputError):
            target.read(seed_path)
    held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (held + MEMORY, held + MEMORY))
    end, number = time.monotonic() + seconds, first
    while time.monotonic() < end:
        folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
        try:
            signal.setitimer(signal.ITIMER_PROF, SECONDS)
            outcome, line = attempt(target, seed, number, folder)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
            shutil.rmtree(folder, ignore_errors=True)
        text = line.encode("utf-8", "replace")[:4000] if outcome == FOUND else b""
        os.write(answers, struct.pack("<BI", outcome, len(text)) + text)
        number += 1


class Worker:
    """Counts what came of the inputs of one reader, and keeps those that are findings.

    Args:
        target: the reader.
        seed: of all inputs.
        out: folder for findings.
    """

    def __init__(self, target: Target, seed: int, out: Path) -> None:
        self.target, self.seed, self.out = target, seed, out
        target.seeds()  # made here, for all processes
        self.tried = self.read = self.refused = 0
        self.findings: dict[str, str] = {}

    def work(self, seconds: float) -> None:
        """Go on for so long, in a process of its own."""
        there, here = os.pipe()
        process = os.fork()
        if process == 0:
            os.close(there)
            try:
                serve(self.target, self.seed, self.tried, seconds, here)
            finally:
                os._exit(0)
        os.close(here)
        with os.fdopen(there, "rb", buffering=0) as answers:
            while select.select([answers], [], [], STUCK)[0]:
                head = answers.read(5)
                if not head:
                    break
                outcome, length = struct.unpack("<BI", head)
                self.take(outcome, answers.read(length).decode() if length else "")
            else:
                os.kill(process, signal.SIGKILL)
                self.take(FOUND, f"stuck for {STUCK:g} s")
        _, status = os.waitpid(process, 0)
        if os.WIFSIGNALED(status) and os.WTERMSIG(status) != signal.SIGKILL:
            self.take(FOUND, f"crashed: signal {os.WTERMSIG(status)}")

    def take(self, outcome: int, line: str) -> None:
        """One more input is known."""
        number = self.tried
        self.tried += 1
        self.read += outcome == READ
        self.refused += outcome == REFUSED
        if outcome != FOUND:
            return
        # One for each place in the source, whatever the numbers in the message.
        key = re.sub(r"'.*'|\d+(?!:)", "", line.split(": ")[0] + line.split(":")[-1])[:120]
        if key in self.findings:
            return
        kept = self.out / f"{self.target.name}-{self.seed}-{number}"
        shutil.rmtree(kept, ignore_errors=True)
        kept.mkdir(parents=True)
        self.target.make(random.Random(f"{self.seed} {self.target.name} {number}"), kept)
        self.findings[key] = f"{self.target.name}, input {number}, {kept}: {line}"
        print(self.findings[key], flush=True)
