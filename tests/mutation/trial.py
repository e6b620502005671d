"""Run the tests of a module in a copy of the checkout."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from tests.mutation.change import Change
from tests.test_mirror import MIRRORS, TESTED_IN

NO_TESTS = 5
"""Exit status of pytest where the marks leave no test."""

Outcome = Literal["noticed", "noticed: too long", "survived", "does not compile"]


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


def tests_of(file: str, root: Path, also: dict[str, list[str]]) -> list[list[str]]:
    """The mirrored file, then those that `also` names: asked only where the former notices nothing."""
    package = next(package for package in MIRRORS if file.startswith(package + "/"))
    inside = Path(file).relative_to(package).with_suffix("")
    name = (Path(MIRRORS[package]) / inside).as_posix()
    mirror = TESTED_IN.get(name)
    path = Path("tests") / (f"{mirror}.py" if mirror else f"{Path(name).parent}/test_{inside.name}.py")
    longest = max((prefix for prefix in also if file.startswith(prefix)), key=len, default="")
    rest = [test for test in also.get(longest, []) if test != path.as_posix()]
    stages = [[test for test in stage if (root / test).is_file()] for stage in ([path.as_posix()], rest)]
    return [stage for stage in stages if stage]


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
        self.seconds: dict[tuple[str, ...], float] = {}
        copy_of(root, folder)

    def commands(self, file: str) -> list[tuple[str, ...]]:
        """What to run, one after the other, until one notices something."""
        if file.endswith(".c"):
            make = "make -s -C robot/firmware HOST='cc -w'"
            return [("sh", "-c", f"{make} build/test && robot/firmware/build/test"), ("sh", "-c", f"{make} test")]
        stages = tests_of(file, self.folder, self.settings["also"])[: 1 if self.mirrored else None]
        quiet = ["-x", "-q", "-p", "no:cacheprovider", "-n", "0", "--tb=no", "-m", self.settings["marks"]]
        return [(self.python, "-m", "pytest", *quiet, *tests) for tests in stages]

    def run(self, command: Sequence[str], limit: float) -> int | None:
        """Exit status; None when it took too long, and everything it began is gone."""
        paths = os.pathsep.join(str(self.folder / part) for part in ("", "robot", "train"))
        threads = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl")}
        environment = os.environ | threads | {"PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"}
        process = subprocess.Popen(
            command,
            cwd=self.folder,
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            return process.wait(limit)
        except subprocess.TimeoutExpired:
            return None
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()

    def unchanged(self, command: tuple[str, ...]) -> float:
        """Seconds that these tests take without any change.

        Raises:
            RuntimeError: they fail, so they can say nothing about a change.
        """
        if command not in self.seconds:
            began = time.monotonic()
            if self.run(command, 600) not in (0, NO_TESTS):
                raise RuntimeError(f"these tests fail without any change: {' '.join(command)}")
            self.seconds[command] = time.monotonic() - began
        return self.seconds[command]

    def try_change(self, change: Change) -> Outcome:
        """Do the tests notice this change?"""
        path = self.folder / change.file
        text = path.read_text(encoding="utf-8")
        for command in self.commands(change.file):
            limit = 3 * self.unchanged(command) + self.settings["patience"]
            path.write_text(change.applied(text), encoding="utf-8")
            try:
                check = ["cc", "-fsyntax-only", "-std=c11", str(path)]
                if change.file.endswith(".c") and self.run(check, limit) != 0:
                    return "does not compile"
                status = self.run(command, limit)
            finally:
                path.write_text(text, encoding="utf-8")
            if status is None:
                return "noticed: too long"
            if status not in (0, NO_TESTS):
                return "noticed"
        return "survived"
