"""Bridges from the loop to other systems, such as MAVLink and ROS 2; see docs/robot/bridges.md.

`[bridges.mavlink]` in a car's file opens one beside the loop. A bridge is a class that inherits `Bridge`, a table of
settings, and a function of settings and opening with `@bridge(name)`: a file in this folder, or anywhere else.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ndtorch.utils.registry import Registry
from ndtorch_robot.link import read_settings
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import Drive, Report, Step
from ndtorch_robot.step_thread import StepThread

POLL = 0.01
"""Seconds between two calls of `idle` at most."""

CLOSE_TIMEOUT = 1.0
"""Seconds to wait for a bridge at the end: one that hangs is left behind."""


@dataclass
class Opening:
    """What a bridge is opened with.

    Attributes:
        report: called for every event.
        runner: of the car, whose rig, map and controller do not change.
        drive: of the car: a bridge over the same line shares its connection.
    """

    report: Report
    runner: NavigatorRunner
    drive: Drive | None = None


class Bridge(StepThread):
    """An observer of the loop with a connection to another system, in a thread of its own.

    Another bridge sends the newest step in `handle`, takes what has arrived in `idle`, gives everything back in
    `finish`, and calls this constructor last. In these methods it may be slow or raise.
    """

    def __init__(self, name: str, report: Report) -> None:
        super().__init__(f"bridge {name}", 1, "newest", report, POLL)

    def __call__(self, step: Step) -> None:
        self.put(step)

    def fail(self, words: str) -> None:
        super().fail(words)
        if threading.current_thread() is self.thread:
            with contextlib.suppress(Exception):
                self.finish()

    def close(self, patience: float | None = CLOSE_TIMEOUT) -> None:
        super().close(patience)


BRIDGES: Registry[Callable[..., Bridge]] = Registry("bridge", __name__)
bridge = BRIDGES.register


@contextlib.contextmanager
def open_bridges(tables: Mapping[str, Mapping[str, Any]], opening: Opening) -> Iterator[list[Bridge]]:
    """The bridges of the `[bridges]` tables, each an observer of the loop, closed afterwards."""
    with contextlib.ExitStack() as stack:
        bridges = []
        for name, values in tables.items():
            opener = BRIDGES.find(name)
            settings = read_settings(opener, values, f"bridges.{name}")
            bridges.append(stack.enter_context(opener(settings, opening)))
        yield bridges
