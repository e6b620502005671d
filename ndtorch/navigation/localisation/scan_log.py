"""Log of the scans since the start, replayed once the odometry is calibrated.

The first scans are placed with an uncalibrated odometer, and all later ones are matched to them. So the log is replayed
with the calibration learned by then, one scan a step beside the driving, and its result replaces the first one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from ndtorch.navigation.localisation.ndt import Scan
from ndtorch.navigation.localisation.params import ReplayParams
from ndtorch.navigation.localisation.pose_graph import Floats

if TYPE_CHECKING:
    from ndtorch.navigation.localisation.state import LocaliserState


class LogEntry(NamedTuple):
    """A scan and the odometry that led to it.

    Attributes:
        age: steps since the start.
        odometry: pose by corrected odometry, `[3]`.
        seconds: duration of driving since the entry before.
        scan: the scan.
        variance: of distance and turn since the entry before, `[2]`.
    """

    age: int
    odometry: Floats
    seconds: float
    scan: Scan
    variance: Floats


class ScanLog(NamedTuple):
    """Entries since the start.

    Attributes:
        entries: in their order, without those of a standing car.
        distance, seconds: driven since the start, m, and since the last entry, s.
        replays: number of replays made.
        replay: state of the replaying localiser; None while there is none.
        position: number of entries replayed.
    """

    entries: tuple[LogEntry, ...] = ()
    distance: float = 0.0
    seconds: float = 0.0
    replays: int = 0
    replay: LocaliserState | None = None
    position: int = 0


def drive(log: ScanLog, distance: float, seconds: float) -> ScanLog:
    """The log after a step."""
    return log._replace(distance=log.distance + distance, seconds=log.seconds + seconds)


def add_entry(log: ScanLog, scan: Scan, age: int, odometry: Floats, variance: Floats) -> ScanLog:
    """The log with one more scan."""
    entry = LogEntry(age, odometry, log.seconds, scan, variance)
    return log._replace(entries=(*log.entries, entry), seconds=0.0)


def is_due(log: ScanLog, params: ReplayParams) -> bool:
    """Whether a replay is to begin."""
    return log.distance >= params.after_m[log.replays]


def finish_replay(log: ScanLog, params: ReplayParams) -> ScanLog | None:
    """The log after a replay; None after the last one."""
    replays = log.replays + 1
    return log._replace(replays=replays, replay=None, position=0) if replays < len(params.after_m) else None
