"""Bridges by name: `[bridges.mavlink]` in a car's file opens one beside the loop.

A bridge is one file in this folder, or anywhere in a program of one's own: a class that inherits `Bridge`, a table of
what its section of the file may say, and a function that opens it, with `@bridge` before it.
"""

from __future__ import annotations

import contextlib
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from ndtorch_robot.kinds import Kinds
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import STAND, DriveCommand, Report, Step

POLL = 0.01
"""Seconds that a bridge waits for a step before it looks for what has arrived."""

CLOSE_TIMEOUT = 1.0
"""Seconds to wait for a bridge at the end: one that hangs is left behind."""


SLOWEST = 0.05
"""m/s: a slower command that turns would turn on the spot, which has no curvature: it is a stand."""


def command_of(speed: float, turn_rate: float) -> DriveCommand:
    """A command of m/s and rad/s, positive to the left, as speed and curvature."""
    return DriveCommand(speed, turn_rate / speed) if abs(speed) >= SLOWEST else STAND


class Wish:
    """The newest command from outside; any thread may give one.

    Args:
        timeout: s; an older command counts as standing, as in Nav2's velocity smoother and collision monitor.
        now: the time, s.
    """

    def __init__(self, timeout: float = 0.5, now: Callable[[], float] = time.monotonic) -> None:
        self.timeout, self.now = timeout, now
        self.newest = (STAND, float("-inf"))

    def put(self, command: DriveCommand) -> None:
        """Drive like this from now on."""
        self.newest = (command, self.now())

    def __call__(self) -> DriveCommand:
        """The command, or a stand where none has come for `timeout`."""
        command, time_ = self.newest
        return command if self.now() - time_ <= self.timeout else STAND


@dataclass
class Opening:
    """What is known when a bridge is opened.

    Attributes:
        robot: name of the car.
        report: called for every event.
        runner: of the car, whose rig, map and controller do not change.
        link: the `[link]` table of the car: a bridge to the same device shares its connection.
        wish: where commands from outside go; None where nobody listens to them.
    """

    robot: str
    report: Report
    runner: NavigatorRunner
    link: Mapping[str, Any] = field(default_factory=dict)
    wish: Wish | None = None


class Bridge(ABC):
    """A connection to another system. All methods are called in the bridge's own thread, and may be slow or raise."""

    @abstractmethod
    def publish(self, step: Step) -> None:
        """Send what there is to say about the newest step; older ones may have been left out."""

    def poll(self) -> None:  # noqa: B027  nothing comes back from some
        """Take what has arrived; called at least every `POLL` seconds. Must not wait."""

    def close(self) -> None:  # noqa: B027
        """Give everything back."""


BRIDGES: Kinds[Opening, Bridge] = Kinds("bridge", __package__)
bridge = BRIDGES.register


class BridgeThread:
    """An observer of the loop that hands the newest step to a bridge in a thread of its own.

    The loop never waits: a step that the bridge has not taken when the next one comes is left out. When the bridge
    raises, it is over, which is reported in one line, and the car goes on.

    Args:
        name: of the bridge, for messages.
        bridge: may be slow, may hang, may raise.
        report: called when it ends before it should.

    Attributes:
        taken, skipped: steps so far.
        failed: why it has ended, or nothing.
    """

    def __init__(self, name: str, bridge: Bridge, report: Report) -> None:
        self.name, self.bridge, self.report = name, bridge, report
        self.newest: Step | None = None
        self.news, self.closing = threading.Event(), threading.Event()
        self.taken = self.skipped = 0
        self.failed = ""
        self.thread = threading.Thread(target=self.run, name=f"bridge {name}", daemon=True)
        self.thread.start()

    def __call__(self, step: Step) -> None:
        self.skipped += self.news.is_set()
        self.newest = step
        self.news.set()

    def run(self) -> None:
        try:
            while not self.closing.is_set():
                if self.news.wait(POLL):
                    self.news.clear()
                    step = self.newest
                    assert step is not None
                    self.bridge.publish(step)
                    self.taken += 1
                self.bridge.poll()
        except Exception as error:  # whatever it is, driving goes on
            self.failed = " ".join(f"{type(error).__name__}: {error}".split())
            self.report(f"the bridge {self.name} has ended: {self.failed}")
        finally:
            with contextlib.suppress(Exception):
                self.bridge.close()

    def close(self) -> None:
        """End the bridge; one that hangs is left behind."""
        self.closing.set()
        self.thread.join(CLOSE_TIMEOUT)
        if self.thread.is_alive():
            self.report(f"the bridge {self.name} hangs: left behind")


@contextlib.contextmanager
def open_bridges(tables: Mapping[str, Mapping[str, Any]], opening: Opening) -> Iterator[list[BridgeThread]]:
    """The bridges of the `[bridges]` tables, each an observer of the loop, closed afterwards."""
    with contextlib.ExitStack() as stack:
        threads = []
        for name, values in tables.items():
            kind, settings = BRIDGES.checked(name, values, f"bridges.{name}")
            threads.append(BridgeThread(name, kind.open(settings, opening), opening.report))
            stack.callback(threads[-1].close)
        yield threads
