"""Bridges from the loop to other systems, such as MAVLink and ROS 2; see docs/robot/bridges.md.

`[bridges.mavlink]` in a car's file opens one beside the loop. A bridge is a class that inherits `Bridge`, a table of
settings, and a function of settings and opening with `@bridge(name)`: a file in this folder, or anywhere else.
"""

from __future__ import annotations

import contextlib
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ndtorch.utils.registry import Registry
from ndtorch_robot.link import read_settings
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import Drive, Report, Step
from ndtorch_robot.step_thread import StepThread

__all__ = ["BRIDGES", "Bridge", "BridgeThread", "Opening", "bridge", "open_bridges"]

POLL = 0.01
"""Seconds that a bridge waits for a step before it looks for what has arrived."""

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


class Bridge(ABC):
    """A connection to another system. All methods are called in the bridge's own thread, and may be slow or raise."""

    @abstractmethod
    def publish(self, step: Step) -> None:
        """Send the newest step; older ones may have been left out."""

    def poll(self) -> None:  # noqa: B027  nothing comes back from some
        """Take what has arrived; called at least every `POLL` seconds. Must not wait."""

    def close(self) -> None:  # noqa: B027
        """Give everything back."""


BRIDGES: Registry[Callable[..., Bridge]] = Registry("bridge", __name__)
bridge = BRIDGES.register


class BridgeThread(StepThread):
    """An observer of the loop that hands the newest step to a bridge in a thread of its own.

    Attributes:
        taken: steps so far.
    """

    def __init__(self, name: str, bridge: Bridge, report: Report) -> None:
        self.bridge, self.taken = bridge, 0
        super().__init__(f"bridge {name}", 1, "newest", report, POLL)

    def __call__(self, step: Step) -> None:
        self.put(step)

    def handle(self, item: Step) -> None:
        self.bridge.publish(item)
        self.taken += 1

    def idle(self) -> None:
        self.bridge.poll()

    def finish(self) -> None:
        self.bridge.close()

    def fail(self, words: str) -> None:
        super().fail(words)
        if threading.current_thread() is self.thread:
            with contextlib.suppress(Exception):
                self.bridge.close()


@contextlib.contextmanager
def open_bridges(tables: Mapping[str, Mapping[str, Any]], opening: Opening) -> Iterator[list[BridgeThread]]:
    """The bridges of the `[bridges]` tables, each an observer of the loop, closed afterwards."""
    with contextlib.ExitStack() as stack:
        threads = []
        for name, values in tables.items():
            opener = BRIDGES.find(name)
            settings = read_settings(opener, values, f"bridges.{name}")
            threads.append(BridgeThread(name, opener(settings, opening), opening.report))
            stack.callback(threads[-1].close, CLOSE_TIMEOUT)
        yield threads
