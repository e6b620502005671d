"""Localisation: odometry corrected by matching ranges with a map made on the way, or with a known map."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from torch import from_numpy

from ndtorch.arguments import check_number
from ndtorch.errors import InputError
from ndtorch.navigation.localisation import odometry as wheels
from ndtorch.navigation.localisation.ndt import Cells, Floats, Scan, ScanMatch, add_scan, empty_map, match_scan
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.stereo.ranging import triangulate
from ndtorch.navigation.stereo.rig import StereoRig
from ndtorch.navigation.stereo.search import SearchParams, search_rows

SEARCH = SearchParams(count=32, min_disparity_px=8)  # stereo search of a scan
SCAN_INTERVAL_S = 0.2  # time between two scans
MIN_RANGE_M, MAX_RANGE_M = 0.9, 6.5  # shorter and longer ranges are ignored

CELL_M, MAP_CELLS = 0.25, 256
"""Side of an NDT cell ([Biber & Straßer 2003] use 1 m for a laser), and number of cells along each side of the map."""

SETTLE_S = 1.0  # scans before this time are added to a new map without being matched
MIN_POINTS = 3  # scans of fewer points are neither matched nor added
FULL_WEIGHT_RANGE_M = 2.5  # points up to this range weigh 1, farther ones less by the square of the range

SIGMA_M, SIGMA_RAD = 0.001, 0.0003
"""Standard deviations of odometry between two scans, beside those of its fusion."""

KNOWN_SIGMA_M, KNOWN_SIGMA_RAD = 0.1, 0.05
"""Standard deviations of the pose at which a drive in a known map starts."""

SEARCH_SIGMAS = 3.0  # a scan match begins with this many standard deviations of the predicted pose

INFORMATION_SCALE, MIN_SCORE = 0.05, 0.1
"""Factor of the information of a scan match, as its points are not independent; one with less score is rejected."""

MIN_SIGMA_M, MIN_SIGMA_RAD = 0.01, 0.006  # standard deviations of a scan match, at best
SLIP_GATE = 16.0  # odometry counts as slipping beyond this squared Mahalanobis distance of a scan match


class LocaliserState(NamedTuple):
    """State of `Localiser`."""

    ndt_map: Cells  # `[MAP_CELLS, MAP_CELLS, 6]`, see `ndt`
    pose: Floats  # x, y, m, and heading, radians, in the map, `[3]`
    covariance: Floats  # of the pose, `[3, 3]`
    wheels: wheels.OdometryState  # state of odometry
    age: int = 0  # steps since the start
    score: float = 0.0  # of the last scan match, 0..1

    @property
    def odometry(self) -> Floats:
        """The pose by fused odometry, which never jumps, `[3]`."""
        return wheels.fused_pose(self.wheels)


class Localiser:
    """Corrects dead reckoning by landmarks: the ranges of both rows, matched with all that was ranged before.

    A few times a second both rows are searched for ranges, and for the points of the last scan, which gives the motion
    since then even where the wheels slip (`odometry`). The scan is matched with the map by NDT, a Kalman filter weighs
    the match against odometry, and the scan is added to the map. Where the error has grown beyond about a cell and a
    half, a loop is not closed.

    Called once a frame, `state = localiser(rows, reckoned, state)`, for one car.

    Shapes:
        rows: both gray rows, an array `[2, W]`, 0..1, or None where it is not `due`; reckoned: `Pose` of `[]`.
        `state=None` starts at the reckoned pose, in an empty map or in the known one.

    Args:
        rig: the camera pair.
        dt: time step, s.
        known: NDT map made before, `[MAP_CELLS, MAP_CELLS, 6]`, in which the reckoned pose at the start is known to
            about .1 m and 3 degrees.

    Raises:
        InputError: a time step that cannot be, several cars at once, or a known map of another size.
    """

    def __init__(self, rig: StereoRig, dt: float, known: Cells | None = None) -> None:
        check_number("dt", dt, above=0, unit="seconds")
        self.rig, self.dt, self.known, self.every = rig, dt, known, max(1, round(SCAN_INTERVAL_S / dt))
        if known is not None and known.shape != (MAP_CELLS, MAP_CELLS, 6):
            raise InputError(f"a known map must be [{MAP_CELLS}, {MAP_CELLS}, 6], got {tuple(known.shape)}")

    def warm_up(self) -> None:
        points, here = np.linspace(1.0, 2.0, 8), np.zeros(3)
        scan, rows = Scan(points, points - 1.5, np.ones(8)), np.zeros((2, self.rig.width), np.float32)
        match_scan(add_scan(empty_map(MAP_CELLS), scan, here, CELL_M), scan, here, (0.1, 0.1), CELL_M)
        wheels.visual_motion(wheels.with_keyframe(wheels.start_odometry(here), rows, scan), rows, self.rig)

    def due(self, state: LocaliserState | None) -> bool:
        return state is None or state.age % self.every == 0

    def __call__(self, rows: Cells | None, reckoned: Pose, state: LocaliserState | None = None) -> LocaliserState:
        due = self.due(state)
        if np.ndim(reckoned.x) or (due and (rows is None or rows.ndim != 2)):
            raise InputError(f"expected one pose and rows [2, W], got {np.shape(reckoned.x)} and {rows}")
        pose = np.array([float(part) for part in reckoned])
        if not np.isfinite(pose).all():
            raise InputError(f"reckoned must be finite, got {reckoned}")
        state = self.start(pose) if state is None else state
        state = self.move(state, wheels.advance(state.wheels, pose, self.dt))
        if due and rows is not None:
            state = self.process_scan(np.ascontiguousarray(rows, np.float32), state)
        return state._replace(age=state.age + 1)

    def start(self, pose: Floats) -> LocaliserState:
        """The state of a car at a pose that has ranged nothing yet."""
        sigma = np.array((KNOWN_SIGMA_M, KNOWN_SIGMA_M, KNOWN_SIGMA_RAD)) * (self.known is not None)
        ndt_map = empty_map(MAP_CELLS) if self.known is None else self.known
        return LocaliserState(ndt_map, pose, np.diag(sigma**2), wheels.start_odometry(pose))

    def reset_pose(self, state: LocaliserState, at: Pose) -> LocaliserState:
        """The state of a car that was carried to a known pose."""
        pose, fresh = np.array([float(part) for part in at]), state.wheels
        fresh = wheels.start_odometry(pose)._replace(errors=fresh.errors, covariance=fresh.covariance)
        return state._replace(pose=pose, wheels=fresh)

    def move(self, state: LocaliserState, moved: wheels.OdometryState) -> LocaliserState:
        """Move the pose as odometry has moved, and its covariance with it."""
        before, after = state.odometry, wheels.fused_pose(moved)
        turned = state.pose[2] - before[2]
        cos, sin, (dx, dy, turn) = math.cos(turned), math.sin(turned), (after - before).tolist()
        step, lever = np.array((cos * dx - sin * dy, sin * dx + cos * dy, turn)), np.eye(3)
        lever[0, 2], lever[1, 2] = -step[1], step[0]
        return state._replace(pose=state.pose + step, covariance=lever @ state.covariance @ lever.T, wheels=moved)

    def process_scan(self, rows: Cells, state: LocaliserState) -> LocaliserState:
        """Fuse odometry, match the scan of both rows with the map, and add it."""
        stands = not state.wheels.since.any()
        fused, variance = wheels.fuse(
            state.wheels, None if stands else wheels.visual_motion(state.wheels, rows, self.rig)
        )
        scan = self.scan(rows)
        state = self.move(state, wheels.with_keyframe(fused, rows, scan))
        settles = self.known is None and state.age * self.dt < SETTLE_S
        if stands and state.age and not settles:
            return state  # a standing car sees the same again
        distance, turn = variance.tolist()
        noise = np.diag((distance + SIGMA_M**2, distance + SIGMA_M**2, turn + SIGMA_RAD**2))
        state = state._replace(covariance=state.covariance + noise * (not settles))
        scan = Scan(*(part[scan.weight > 0] for part in scan))
        if len(scan.x) < MIN_POINTS:
            return state
        if not settles:
            place, angle = SEARCH_SIGMAS * np.sqrt(state.covariance.diagonal()[1:])
            place = max(place, SEARCH_SIGMAS * math.sqrt(state.covariance[0, 0])) + MIN_SIGMA_M
            match = match_scan(state.ndt_map, scan, state.pose, (place, angle + MIN_SIGMA_RAD), CELL_M)
            state = self.correct(state, match)
        return state._replace(ndt_map=add_scan(state.ndt_map, scan, state.pose, CELL_M))

    def scan(self, rows: Cells) -> Scan:
        """Points ranged in both gray rows `[2, W]`; those outside the ranges that count weigh nothing."""
        ranges = triangulate(search_rows(from_numpy(rows), SEARCH), self.rig)
        x, y = (part[ranges.valid].double().numpy() for part in (ranges.x, ranges.y))
        distance = np.hypot(x, y)
        weight = np.minimum(1.0, (FULL_WEIGHT_RANGE_M / np.maximum(distance, MIN_RANGE_M)) ** 2)
        return Scan(x, y, np.where((distance > MIN_RANGE_M) & (distance < MAX_RANGE_M), weight, 0.0))

    def correct(self, state: LocaliserState, match: ScanMatch) -> LocaliserState:
        """The pose after a scan match: one step of the Kalman filter."""
        covariance = state.covariance
        if match.score < MIN_SCORE:
            return state._replace(score=match.score)
        noise = np.linalg.inv(match.information * INFORMATION_SCALE + 1e-3 * np.eye(3))
        noise = noise + np.diag(np.square((MIN_SIGMA_M, MIN_SIGMA_M, MIN_SIGMA_RAD)))
        innovation = match.pose - state.pose
        distance = float(innovation @ np.linalg.solve(covariance + noise, innovation))
        covariance = covariance * max(1.0, distance / SLIP_GATE)
        gain = np.linalg.solve(covariance + noise, covariance).T
        covariance = covariance - gain @ covariance
        pose = state.pose + gain @ innovation
        return state._replace(pose=pose, covariance=(covariance + covariance.T) / 2, score=match.score)
