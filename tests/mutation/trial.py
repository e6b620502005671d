"""Run the tests of a module in a copy of the checkout."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

from tests.mutation.change import Change
from tests.mutation.whom import tests_of

NO_TESTS = 5
"""Exit status of pytest where the marks leave no test."""

Outcome = Literal[
    "noticed", "noticed: wider list", "noticed: too long", "survived", "survived the mirrored file", "does not compile"
]


class Ended(NamedTuple):
    """How a command ended.

    Attributes:
        status: the exit status, None when it took too long.
        cpu: seconds of the processor.
        wall: seconds by the clock.
        failed: the first test that failed; None where no single one is known.
    """

    status: int | None
    cpu: float
    wall: float
    failed: str | None = None


def copy_of(root: Path, folder: Path) -> None:
    """Whatever git knows or would take, so no build and no results; the models too."""
    listed = subprocess.run(
        ["git", "-C", root, "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        capture_output=True,
        text=True,
        check=True,
    )
    for name in filter(None, listed.stdout.split("\0")):
        if (root / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(root / name, folder / name)


class Bench:
    """A copy of the checkout, and how its tests are run.

    Args:
        root: the checkout; never written to.
        folder: where the copy is.
        python: that runs the tests.
        settings: of mutation.toml.
        mirrored: ask no more than the mirrored files.
    """

    def __init__(self, root: Path, folder: Path, python: str, settings: dict[str, Any], mirrored: bool = False) -> None:
        self.mirrored = mirrored
        self.root, self.folder, self.settings = root, folder, settings
        self.python = python
        self.took: dict[tuple[tuple[str, ...], float], Ended] = {}
        self.server: subprocess.Popen[str] | None = None
        copy_of(root, folder)

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the server."""
        if self.server is not None:
            assert self.server.stdin is not None
            self.server.stdin.close()
            self.server.wait()
            self.server = None

    def commands(self, file: str) -> list[tuple[str, ...]]:
        """What to run, one after the other, until one notices something: `pytest` and its arguments, or a program's."""
        if file.endswith(".c"):
            make = "make -s -C robot/firmware HOST='cc -w' CROSS='avr-gcc -w'"
            asked = [f"{make} build/test && robot/firmware/build/test", f"{make} test"]
            if shutil.which("avr-gcc") is not None:
                asked.append(f"{make} test-board")  # an int has 16 bits there
            return [("sh", "-c", each) for each in asked]
        tests = tests_of(file, self.folder, self.settings["also"], self.settings["wider"])
        near = [
            each for prefix, tests in self.settings.get("next", {}).items() if file.startswith(prefix) for each in tests
        ]
        tests = list(dict.fromkeys([*tests[:1], *near, *tests[1:]]))
        quiet = ["-x", "-q", "-p", "no:cacheprovider", "-n", "0", "--tb=no", "-m", self.settings["marks"]]
        return [("pytest", *quiet, test) for test in tests]

    def environment(self) -> dict[str, str]:
        """One thread; the copy's sources; hypothesis draws the same examples every time and keeps none."""
        paths = os.pathsep.join(str(self.folder / part) for part in ("", "robot", "train"))
        threads = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl")}
        return os.environ | threads | {"PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1", "CI": "1"}

    def run(self, command: Sequence[str], cpu: float, wall: float) -> Ended:
        """Exit status; None when it took too long, and everything it began is gone."""
        if command[0] == "pytest":
            return self.forked(command[1:], cpu, wall)
        began = time.monotonic()
        silent = subprocess.DEVNULL
        process = subprocess.Popen(
            command, cwd=self.folder, env=self.environment(), stdout=silent, stderr=silent, start_new_session=True
        )
        status = None
        try:
            status = process.wait(wall)
        except subprocess.TimeoutExpired:
            pass
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        took = time.monotonic() - began
        return Ended(status, took, took)

    def forked(self, arguments: Sequence[str], cpu: float, wall: float) -> Ended:
        """By the server, which is started when it is first wanted."""
        if self.server is None:
            self.server = subprocess.Popen(
                [self.python, str(Path(__file__).with_name("forks.py")), *self.settings["preload"]],
                cwd=self.folder,
                env=self.environment(),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
            )
        assert self.server.stdin is not None
        assert self.server.stdout is not None
        self.server.stdin.write(json.dumps({"arguments": list(arguments), "cpu": cpu, "wall": wall}) + "\n")
        self.server.stdin.flush()
        answer = self.server.stdout.readline()
        if not answer:
            raise RuntimeError("the process that runs the tests has ended")
        return Ended(**json.loads(answer))

    def unchanged(self, command: tuple[str, ...], cpu: float = 900) -> Ended:
        """How these tests end without any change, and what they take; they are given so many seconds."""
        if (command, cpu) not in self.took:  # the mirrored file of one module is in the wider list of another
            self.took[command, cpu] = self.run(command, cpu, 20 * cpu)
        return self.took[command, cpu]

    def try_change(self, change: Change, begin: int = 0) -> Outcome:
        """Do the tests notice this change?

        The tests are run with the change first, because those that notice nothing need not be run without it.

        Args:
            begin: 1 where the mirrored file is known to notice nothing.

        Raises:
            RuntimeError: the mirrored file fails without any change, so it can say nothing about one.
        """
        check = ["cc", "-fsyntax-only", "-std=c11", change.file]
        if change.file.endswith(".c") and self.changed(change, check, 60, 600).status != 0:
            return "does not compile"
        commands = self.commands(change.file)
        for stage, command in enumerate(commands[: 1 if self.mirrored else None]):
            if stage < begin:
                continue
            longest = self.settings["longest"] if stage else 900
            known = self.took.get((command, longest))
            if known is not None and known.status != 0 and stage:
                continue  # it is too slow, fails here anyway, or has no test with these marks: it can say nothing
            # Processor time is what is judged: on a busy machine the clock says nothing.
            cpu = self.settings["longest"] + self.settings["patience"]
            ended = self.changed(change, command, cpu, 20 * cpu)
            if ended.status in (0, NO_TESTS):
                continue
            if not self.passes(command, ended, longest):
                if stage == 0:
                    raise RuntimeError(f"these tests fail without any change: {' '.join(command)}")
                continue
            if ended.status is None:
                took = self.unchanged(command, longest)
                enough = 3 * took.cpu + self.settings["patience"]
                if enough > cpu:
                    ended = self.changed(change, command, enough, 10 * took.wall + 10 * self.settings["patience"])
            if ended.status is None:
                return "noticed: too long"
            if ended.status not in (0, NO_TESTS):
                return "noticed" if stage == 0 else "noticed: wider list"
        return "survived the mirrored file" if self.mirrored and len(commands) > 1 else "survived"

    def changed(self, change: Change, command: Sequence[str], cpu: float, wall: float) -> Ended:
        """How a command ends with this change; the source is as it was afterwards."""
        path = self.folder / change.file
        text = path.read_text(encoding="utf-8")
        path.write_text(change.applied(text), encoding="utf-8")
        try:
            return self.run(command, cpu, wall)
        finally:
            path.write_text(text, encoding="utf-8")

    def passes(self, command: tuple[str, ...], ended: Ended, longest: float) -> bool:
        """Does what failed pass without a change?

        Of the mirrored file the one test that failed is run, which is quick. The others have to pass as a whole, in the
        seconds that they are given.
        """
        alone = ended.failed is not None and longest > self.settings["longest"]
        if alone and (command, longest) not in self.took:
            one = (*command[:-1], str(ended.failed))
            if self.run(one, longest, 20 * longest).status == 0:
                return True
        return self.unchanged(command, longest).status == 0
