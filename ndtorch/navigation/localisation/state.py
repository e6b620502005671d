"""State of the localiser, and the frames in which a pose stays right when submaps are moved."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch

from ndtorch.navigation.localisation._kernels import Cells
from ndtorch.navigation.localisation.ndt import Scan
from ndtorch.navigation.localisation.params import ReplayParams
from ndtorch.navigation.localisation.pose_graph import Floats, compose_poses, relative_pose
from ndtorch.navigation.localisation.relocalisation import Relocalisation
from ndtorch.navigation.localisation.submap import Calibration, SubmapGraph
from ndtorch.navigation.localisation.wheel_odometry import WheelCalibration
from ndtorch.navigation.mapping.range_log import FramePose, Frames

KNOWN_MAP, KNOWN_SIDE_M, KNOWN_SIDES = -1, 4.0, 16
"""Number of the first of the frames of a known map, which never move and are all the same: one for the places in each
of so many squares a side."""


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
    """Log of the scans since the start, replayed once the odometry is calibrated.

    The first scans are placed with an uncalibrated odometer, and all later ones are matched to them. So the log is
    replayed with the calibration learned by then, one scan a step beside the driving, and its result replaces the
    first one.

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

    def drive(self, distance: float, seconds: float) -> ScanLog:
        """The log after a step."""
        return self._replace(distance=self.distance + distance, seconds=self.seconds + seconds)

    def add(self, scan: Scan, age: int, odometry: Floats, variance: Floats) -> ScanLog:
        """The log with one more scan."""
        entry = LogEntry(age, odometry, self.seconds, scan, variance)
        return self._replace(entries=(*self.entries, entry), seconds=0.0)

    def is_due(self, params: ReplayParams) -> bool:
        """Whether a replay is to begin."""
        return self.distance >= params.after_m[self.replays]

    def finish_replay(self, params: ReplayParams) -> ScanLog | None:
        """The log after a replay; None after the last one."""
        replays = self.replays + 1
        return self._replace(replays=replays, replay=None, position=0) if replays < len(params.after_m) else None


class LocaliserState(NamedTuple):
    """State of `Localiser`.

    Attributes:
        ndt_map: `[map_cells, map_cells, 6]`, see `ndt`.
        pose: x, y, m, and heading, radians, `[3]`.
        odometry: pose by odometry after fusion, `[3]`.
        distance, heading_travelled: driven since the last scan, m without sign and radians with it.
        variance: of both, `[2]`.
        wheels: calibration of wheel odometry.
        calibration: remaining scale, bend and drift of `odometry`, `[3]`: the shares by which it overstates distance
            and turn, and the radians that it adds to the heading in each second of driving.
        covariance: of x, y, heading, scale, bend and drift, `[6, 6]`.
        age: steps since the start.
        score: of the last scan match, 0..1.
        relocalisation: the search in a known map; None without one, and once the pose was found.
        graph: submaps; None with a known map and without loop closure.
        log: scans to replay; None after the last replay and without submaps.
    """

    ndt_map: Cells
    pose: Floats
    odometry: Floats
    distance: float
    heading_travelled: float
    variance: Floats
    wheels: WheelCalibration
    calibration: Floats
    covariance: Floats
    age: int = 0
    score: float = 0.0
    relocalisation: Relocalisation | None = None
    graph: SubmapGraph | None = None
    log: ScanLog | None = None


def calibration_of(state: LocaliserState) -> Calibration:
    """Scale, bend and drift with their standard deviations."""
    return Calibration(state.calibration, np.sqrt(state.covariance.diagonal()[3:]))


def since_scan(state: LocaliserState) -> LocaliserState:
    """The state just after a scan."""
    return state._replace(distance=0.0, heading_travelled=0.0, variance=np.zeros(2))


def add_variance(state: LocaliserState, variance: Floats) -> LocaliserState:
    """The state with more variance `[2]` of distance and turn since the last scan and along the submap."""
    state = state._replace(variance=state.variance + variance)
    if state.graph is None:
        return state
    driven = state.graph.driven
    driven = driven._replace(variance=driven.variance + variance)
    return state._replace(graph=state.graph._replace(driven=driven))


def frame_pose(state: LocaliserState) -> FramePose | None:
    """The pose in a frame that moves with the present submap, or with the present scan while it may be replayed.

    None during relocalisation.
    """
    if state.relocalisation is not None:
        return None
    if state.graph is None:
        row, column = (state.pose[:2] // KNOWN_SIDE_M + KNOWN_SIDES // 2).clip(0, KNOWN_SIDES - 1).tolist()
        return FramePose(KNOWN_MAP - row * KNOWN_SIDES - column, tuple(state.pose.tolist()))
    graph = state.graph
    frame, base = float(graph.begun[-1]), graph.poses[-1]
    if state.log is not None and len(graph.scans):
        frame, submap, *at = graph.scans[-1].tolist()
        base = compose_poses(graph.poses[int(submap)], np.array(at))
    return FramePose(frame, tuple(relative_pose(base, state.pose).tolist()))


def lasting_frame(state: LocaliserState, frame: float) -> FramePose | None:
    """Where a frame that has ended stands in one that lasts: itself, or that of the submap that it was merged into.

    None for a frame that is gone.
    """
    graph = state.graph
    if graph is None or frame in graph.begun or frame in graph.scans[:, 0]:
        return FramePose(frame, (0.0, 0.0, 0.0))
    for number, submap, *at in graph.merged_submaps[::-1].tolist():
        if number == frame:
            return FramePose(float(graph.begun[int(submap)]), tuple(at))
    return None


def map_frames(state: LocaliserState) -> Frames:
    """The present poses of all frames of `frame_pose`."""
    graph = state.graph
    if graph is None:
        known = KNOWN_MAP - torch.arange(KNOWN_SIDES**2, dtype=torch.float64)
        return Frames(known, torch.zeros(len(known), 3, dtype=torch.float64))
    more = np.concatenate((graph.merged_submaps, graph.scans))
    poses = compose_poses(graph.poses[more[:, 1].astype(np.int64)], more[:, 2:])
    numbers = np.concatenate((graph.begun, more[:, 0]))
    return Frames(torch.from_numpy(numbers), torch.from_numpy(np.concatenate((graph.poses, poses))))
