"""Localisation: odometry corrected by matching ranges with a map made on the way, or with a known map."""

from __future__ import annotations

import math

import numpy as np
from torch import Tensor, from_numpy

from ndtorch.arguments import check_number, check_state, check_tensor
from ndtorch.errors import InputError
from ndtorch.navigation.localisation import pose_filter, relocalisation, submap, wheel_odometry
from ndtorch.navigation.localisation._kernels import Cells
from ndtorch.navigation.localisation.loop_closure import accept_and_optimise, match_submaps
from ndtorch.navigation.localisation.ndt import Scan, add_scan, empty_map, match_scan
from ndtorch.navigation.localisation.odometry_edge import integrate
from ndtorch.navigation.localisation.params import LocaliserParams
from ndtorch.navigation.localisation.pose_graph import Floats, compose_poses, relative_pose
from ndtorch.navigation.localisation.relocalisation import Relocalisation, no_search
from ndtorch.navigation.localisation.state import LocaliserState, ScanLog, add_variance, calibration_of, since_scan
from ndtorch.navigation.localisation.submap import SubmapGraph
from ndtorch.navigation.localisation.visual_odometry import Rows, estimate_motion, keyframe
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.stereo.ranging import triangulate
from ndtorch.navigation.stereo.rig import StereoRig
from ndtorch.navigation.stereo.search import search_rows

MAX_CALIBRATION = np.array((0.2, 0.2, math.radians(2.0)))
"""Scale, bend and drift, radians/s, stay within these limits."""

FULL_WEIGHT_RANGE_M = 2.5
"""Points up to this range weigh 1, farther ones less by the square of the range."""

SEARCH_SIGMAS = 3.0
"""A scan match begins with this many standard deviations of the predicted pose."""

REPLAY_SPEED = 6
"""The scan log is replayed about this many times as fast as it was driven."""


class Localiser:
    """Corrects dead reckoning by landmarks: the ranges of both rows, matched with all that was ranged before.

    A few times a second both rows are searched for ranges, and for the points of the last scan, which gives the motion
    since then even where the wheels slip (`visual_odometry`, `wheel_odometry`). The scan is matched with the map by
    NDT, and an extended Kalman filter weighs the match against odometry and corrects the remaining scale, bend and
    drift (`pose_filter`). Then the scan is added to the map. Every few metres a submap is finished and matched with
    those it overlaps, one a step; accepted matches close loops in a pose graph, which moves all submaps and the car
    (`submap`, `loop_closure`). The first minutes are replayed with the calibration learned by then (`ScanLog`). A
    loop is closed if its error is below about a cell and a half; there is no search for loops beyond that.

    Called once a frame, `state = localiser(rows, reckoned, state)`, for one car.

    Shapes:
        rows: both gray rows, `[2, W]`, 0..1, or None where it is not `due`; reckoned: `Pose` of `[]`.
        `state=None` starts at the reckoned pose with an empty map.

    Args:
        rig: the camera pair.
        dt: time step, s.
        params: its parameters.
        known: NDT map made before, `[map_cells, map_cells, 6]`. The pose in it is unknown at first: the car drives in
            a frame of its own until what it has mapped fits one place of the known map and no other.

    Raises:
        InputError: a time step that cannot be, several cars at once, or a known map of another size.
    """

    def __init__(
        self, rig: StereoRig, dt: float, params: LocaliserParams | None = None, known: Cells | None = None
    ) -> None:
        check_number("dt", dt, above=0, unit="seconds")
        self.rig, self.dt, self.params = rig, dt, params or LocaliserParams()
        self.every = max(1, round(self.params.scan_interval_s / dt))
        self.settle = self.params.settle_s / dt
        size = self.params.map_cells
        if known is not None and known.shape != (size, size, 6):
            raise InputError(f"a known map must be [{size}, {size}, 6], got {tuple(known.shape)}")
        self.known = known
        self.field = None if known is None else relocalisation.likelihood_field(known, self.params.cell_m)

    def warm_up(self) -> None:
        """Compile or load all kernels."""
        p, ahead, here = self.params, np.linspace(1.0, 2.0, 8), np.zeros(3)
        scan = Scan(ahead, ahead - 1.5, np.ones_like(ahead))
        match_scan(add_scan(empty_map(p.map_cells), scan, here, p.cell_m), scan, here, (0.1, 0.1), p.cell_m)
        before = keyframe(np.zeros((2, self.rig.width), np.float32), scan)
        estimate_motion(before, before.rows, (0.0, 0.0), self.rig, p.odometry.min_matches)
        submap.render_map(submap.add_to_submap(submap.empty_graph(here, p), scan, here, p.cell_m), self.dt, p)
        if self.field is not None:
            pattern = np.stack((scan.x, scan.y), -1)
            search = no_search()._replace(pattern=pattern, rotation=0)
            relocalisation.score_rotation(search, self.field, p.relocalisation)

    def due(self, state: LocaliserState | None) -> bool:
        """Whether the next step takes a scan."""
        return state is None or state.age % self.every == 0

    def __call__(self, rows: Tensor | None, reckoned: Pose, state: LocaliserState | None = None) -> LocaliserState:
        check_state(state, LocaliserState)
        if np.ndim(reckoned.x) or (rows is not None and rows.ndim != 2):
            raise InputError(f"localise knows one car at a time, got poses {np.shape(reckoned.x)}")
        pose, due = as_array(reckoned), self.due(state)
        if due and rows is None:
            raise InputError("this step looks at the rows, see `due`, but there are none")
        if not math.isfinite(pose.sum()):
            raise InputError(f"reckoned must be finite, got {reckoned}")
        if rows is not None:
            check_tensor("rows", rows)
        state = self.start(pose) if state is None else state
        state = state._replace(wheels=wheel_odometry.predict(state.wheels, pose, self.dt))
        state = self.move(state, wheel_odometry.calibrated_pose(state.wheels), self.dt)
        if due and rows is not None:
            state = self.process_scan(rows.detach().cpu().float().contiguous().numpy(), state)
        if state.relocalisation is not None:
            state = self.relocalise(state, state.relocalisation)
        elif not due or self.every == 1:
            if state.graph is not None and len(state.graph.candidates):
                state = self.close_loops(state, state.graph)
            for _ in range(math.ceil(REPLAY_SPEED / self.every)):
                state = state if state.log is None else self.replay(state, state.log)
        return state._replace(age=state.age + 1)

    def start(self, pose: Floats) -> LocaliserState:
        """The state of a car at a pose that has mapped nothing yet."""
        p, known = self.params, self.known is not None
        one_map = known or not p.loop_closure
        covariance = np.diag(np.square([0.0, 0.0, 0.0, p.scale_sigma, p.bend_sigma, p.drift_sigma_rad_per_s]))
        return LocaliserState(
            ndt_map=empty_map(p.map_cells),
            pose=pose,
            odometry=pose,
            distance=0.0,
            heading_travelled=0.0,
            variance=np.zeros(2),
            wheels=wheel_odometry.uncalibrated(pose, p.odometry),
            calibration=np.zeros(3),
            covariance=covariance,
            relocalisation=no_search() if known else None,
            graph=None if one_map else submap.empty_graph(pose, p),
            log=ScanLog() if not one_map and p.replay.after_m else None,
        )

    def reset_pose(self, state: LocaliserState, at: Pose) -> LocaliserState:
        """The state of a car that was carried to a known pose."""
        pose = as_array(at)
        graph = state.graph and submap.restart_at(state.graph, pose, state.age)
        wheels = wheel_odometry.moved_to(state.wheels, pose)
        return since_scan(state._replace(pose=pose, odometry=pose, wheels=wheels, graph=graph, log=None))

    def move(
        self, state: LocaliserState, odometry: Floats, seconds: float, variance: Floats | None = None
    ) -> LocaliserState:
        """Drive on to a pose of odometry `[3]`, corrected by the calibration.

        Args:
            seconds: duration of driving.
            variance: of distance and turn since the last scan, `[2]`, to be added now.
        """
        state = state if variance is None else add_variance(state, variance)
        x, y, heading = odometry.tolist()
        before_x, before_y, before = state.odometry.tolist()
        chord, turn = math.hypot(x - before_x, y - before_y), heading - before
        if chord < 1e-6 and abs(turn) < 1e-9:
            return state
        scale, bend, drift = state.calibration.tolist()
        aside = math.atan2(y - before_y, x - before_x) - before  # of the chord, relative to the heading before it
        length, true_turn = chord * (1 - scale), (turn - drift * seconds) * (1 - bend)
        here_x, here_y, here = state.pose.tolist()
        direction = here + aside + (true_turn - turn) / 2
        pose = (here_x + length * math.cos(direction), here_y + length * math.sin(direction), here + true_turn)
        search, graph, log = state.relocalisation, state.graph, state.log
        if search is not None:
            search = search._replace(distance=search.distance + length)
        if graph is not None:
            driven = integrate(graph.driven, (chord, aside, turn), seconds, state.calibration)
            graph = graph._replace(driven=driven)
        return state._replace(
            pose=np.array(pose),
            odometry=odometry,
            distance=state.distance + length,
            heading_travelled=state.heading_travelled + true_turn,
            relocalisation=search,
            graph=graph,
            log=None if log is None else log.drive(length, seconds),
        )

    def process_scan(self, rows: Rows, state: LocaliserState) -> LocaliserState:
        """Fuse odometry, log the scan of both rows, match it with the map and add it."""
        wheels, variance = wheel_odometry.update(state.wheels, rows, self.rig, self.params.odometry)
        state = self.move(state, wheel_odometry.calibrated_pose(wheels), 0.0, variance)
        scan, log = self.scan(rows), state.log
        state = state._replace(wheels=wheels._replace(keyframe=keyframe(rows, scan)))
        scan = Scan(*(part[scan.weight > 0] for part in scan))
        if state.age >= self.settle and not state.distance and not state.heading_travelled:
            return state  # a standing car sees the same again
        keep = log is not None and (log.seconds > 0 or state.age < self.settle)
        if log is not None and keep:
            state = state._replace(log=log.add(scan, state.age, state.odometry, variance))
        return self.integrate_scan(state, scan, keep)

    def scan(self, rows: Rows) -> Scan:
        """The scan of both rows; points outside the ranges that count weigh nothing."""
        return stereo_scan(rows, self.rig, self.params)

    def integrate_scan(self, state: LocaliserState, scan: Scan, keep: bool = False) -> LocaliserState:
        """Match a scan with the map, correct the pose and add the scan; `keep` gives it a frame of its own, too."""
        if len(scan.x) < 3:
            if not keep or state.graph is None:
                return state
            return state._replace(graph=submap.add_scan_frame(state.graph, state.pose, state.age))
        p = self.params
        if state.age >= self.settle:
            state = self.correct(state, scan)
        pose, graph = state.pose, state.graph
        if graph is not None:
            graph = submap.add_to_submap(graph, scan, pose, p.cell_m)
            graph = submap.add_scan_frame(graph, pose, state.age) if keep else graph
            if submap.is_complete(graph, p.submaps) and not len(graph.candidates):
                graph = submap.finish_submap(graph, pose, state.age, self.dt, calibration_of(state), p)
        return since_scan(state._replace(ndt_map=add_scan(state.ndt_map, scan, pose, p.cell_m), graph=graph))

    def correct(self, state: LocaliserState, scan: Scan) -> LocaliserState:
        """Pose and calibration after a scan match: one step of the extended Kalman filter."""
        p = self.params
        seconds = self.every * self.dt if state.distance > 1e-3 else 0.0
        driven = (state.distance, state.heading_travelled, state.variance, seconds, float(state.pose[2]))
        covariance = pose_filter.predict(
            state.covariance, *driven, p, wheel_odometry.is_calibrated(state.wheels, p.odometry)
        )
        place = SEARCH_SIGMAS * np.sqrt(covariance[[0, 1], [0, 1]].max()) + p.min_sigma_m
        angle = SEARCH_SIGMAS * np.sqrt(covariance[2, 2]) + p.min_sigma_rad
        match = match_scan(state.ndt_map, scan, state.pose, (place, angle), p.cell_m)
        if match.score < p.min_score:
            return state._replace(covariance=covariance, score=match.score)
        change, covariance = pose_filter.update(covariance, match.pose - state.pose, match.information, p)
        return state._replace(
            pose=state.pose + change[:3],
            calibration=np.clip(state.calibration + change[3:], -MAX_CALIBRATION, MAX_CALIBRATION),
            covariance=covariance,
            score=match.score,
        )

    def close_loops(self, state: LocaliserState, graph: SubmapGraph) -> LocaliserState:
        """Match the next pair of submaps; after the last one optimise the graph and move the car with it."""
        graph = match_submaps(graph, self.params)
        if len(graph.candidates):
            return state._replace(graph=graph)
        before = graph.poses[-1]
        graph = accept_and_optimise(graph, calibration_of(state), self.params.submaps)
        pose = compose_poses(graph.poses[-1], relative_pose(before, state.pose))
        # Headings keep their full turns.
        pose[2] += 2 * math.pi * round((state.pose[2] - pose[2]) / (2 * math.pi))
        return state._replace(graph=graph, pose=pose, ndt_map=submap.render_map(graph, self.dt, self.params))

    def replay(self, state: LocaliserState, log: ScanLog) -> LocaliserState:
        """Replay the scan log where it is due, one scan or one pair of submaps a call."""
        p, again = self.params.replay, log.replay
        if again is None:
            return state._replace(log=log._replace(replay=self.restart(state, log))) if log.is_due(p) else state
        assert again.graph is not None
        if len(again.graph.candidates):
            again = self.close_loops(again, again.graph)
        elif log.position < len(log.entries):
            entry = log.entries[log.position]
            again = self.move(again._replace(age=entry.age), entry.odometry, entry.seconds, entry.variance)
            again = self.integrate_scan(again, entry.scan, keep=True)
            log = log._replace(position=log.position + 1)
        else:
            again = self.move(again, state.odometry, log.seconds)
            return again._replace(age=state.age, wheels=state.wheels, log=log.finish_replay(p))
        return state._replace(log=log._replace(replay=again))

    def restart(self, state: LocaliserState, log: ScanLog) -> LocaliserState:
        """The state of a car at the beginning of the log that has the present calibration."""
        covariance = np.zeros_like(state.covariance)
        covariance[3:, 3:] = state.covariance[3:, 3:] * self.params.replay.sigma_scale**2
        again = self.start(log.entries[0].odometry)
        assert again.graph is not None
        # Only the first submap has nothing yet to be matched with.
        graph = again.graph._replace(learning_s=self.dt)
        again = again._replace(calibration=state.calibration, covariance=covariance, wheels=state.wheels)
        return again._replace(graph=graph, log=None)

    def relocalise(self, state: LocaliserState, search: Relocalisation) -> LocaliserState:
        """One step of the search for the pose in the known map."""
        p, cell_m = self.params.relocalisation, self.params.cell_m
        assert self.known is not None
        assert self.field is not None
        if search.rotation < 0:
            if search.distance > p.first_search_m:
                search = relocalisation.start_search(search, state.ndt_map, state.pose, cell_m, p)
        elif search.rotation < p.rotations:
            search = relocalisation.score_rotation(search, self.field, p)
        elif len(search.candidates):
            search = relocalisation.refine(search, self.known, cell_m)
        else:
            found = relocalisation.best_pose(search, p)
            if found is not None:
                pose = relocalisation.pose_now(search, found, state.pose)
                return state._replace(ndt_map=self.known, pose=pose, relocalisation=None)
            search = no_search()._replace(distance=search.distance)
        return state._replace(relocalisation=search)


def as_array(pose: Pose) -> Floats:
    """A single pose as x, y, heading `[3]`."""
    return np.array([float(part) for part in pose])


def stereo_scan(rows: Rows, rig: StereoRig, params: LocaliserParams) -> Scan:
    """Points ranged in both gray rows `[2, W]`; those outside the ranges that count weigh nothing."""
    p = params
    ranges = triangulate(search_rows(from_numpy(rows), p.stereo), rig)
    x, y = (part[ranges.valid].double().numpy() for part in (ranges.x, ranges.y))
    distance = np.hypot(x, y)
    weight = np.minimum(1.0, (FULL_WEIGHT_RANGE_M / np.maximum(distance, p.min_range_m)) ** 2)
    return Scan(x, y, np.where((distance > p.min_range_m) & (distance < p.max_range_m), weight, 0.0))
