"""Parameters of the localiser that a user may tune; what nobody tunes is a constant in the module that uses it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch.navigation.stereo.search import SearchParams


class Positive:
    """A dataclass of numbers that must be above 0."""

    def __post_init__(self) -> None:
        check_numbers(self, positive=vars(self))


@dataclass(frozen=True)
class OdometryParams(Positive):
    """How wheel odometry is calibrated and fused with visual odometry.

    Args:
        min_matches: Visual odometry needs at least this many matched places in the two rows.
        scale_sigma: This is the prior standard deviation of the wheels' scale error (ratio of distance and turn).
        bend_sigma: This is the prior standard deviation of the wheels' turn error (ratio of the turn).
        drift_sigma_rad_per_s: This is the prior standard deviation of the drift of the heading.
        slip_gate: Wheel odometry counts as slipping beyond this squared Mahalanobis distance from visual odometry.

    Raises:
        InputError: A number is not positive.
    """

    min_matches: int = 2
    scale_sigma: float = 0.1
    bend_sigma: float = 0.03
    drift_sigma_rad_per_s: float = math.radians(0.2)
    slip_gate: float = 9.0


@dataclass(frozen=True)
class SubmapParams(Positive):
    """How submaps are made and when a loop closure between two of them is accepted.

    Args:
        length_m: A submap is complete after this driven distance if it has `min_cells` cells.
        max_length_m: A submap is complete after this driven distance whatever it shows.
        min_cells: A submap needs this many cells to be complete before `max_length_m`.
        redundant_views: A place counts as known after this many submaps have shown it.
        redundant_ratio: A submap is dropped if more than this share of its cells is known.
        max_submaps: The map grows no further than this number of submaps.
        learning_s: Submaps that begin before this time are used only where no later submap shows anything.
        min_score: A match between two submaps needs at least this score (0..1).
        large_correction_count: A loop closure that moves this many submaps significantly needs confirmation.
        confirmation_gate: Two loop closures agree within this squared Mahalanobis distance.
        confirmation_max_submaps: An unconfirmed loop closure is dropped after this many further submaps.

    Raises:
        InputError: A number is not positive.
    """

    length_m: float = 2.0
    max_length_m: float = 6.0
    min_cells: int = 12
    redundant_views: int = 3
    redundant_ratio: float = 0.9
    max_submaps: int = 150
    learning_s: float = 1.0
    min_score: float = 0.3
    large_correction_count: int = 5
    confirmation_gate: float = 9.0
    confirmation_max_submaps: int = 30


@dataclass(frozen=True)
class ReplayParams:
    """When the scan log is replayed with the odometry calibration learned by then.

    Args:
        after_m: The log is replayed at these driven distances, which must grow; it is never replayed if empty.
        sigma_scale: The standard deviations of the calibration are multiplied by this factor before a replay,
            because they are too small: later scans were matched to a map with the same error.

    Raises:
        InputError: The distances do not grow, or the factor is not positive.
    """

    after_m: tuple[float, ...] = (57.0, 115.0)
    sigma_scale: float = 4.0

    def __post_init__(self) -> None:
        check_numbers(self, positive=("sigma_scale",))
        if not all(before < after for before, after in pairwise((0.0, *self.after_m))):
            raise InputError(f"after_m must be distances > 0 that grow, got {self.after_m}")


@dataclass(frozen=True)
class RelocalisationParams(Positive):
    """How the pose in a known map is found from an unknown start.

    Args:
        first_search_m: A search starts after this driven distance, and again after every failed search.
        retry_m: A search that has too few cells is tried again after this driven distance.
        radius_m: Cells within this distance of the car are matched with the known map.
        min_cells: A search needs at least this many cells.
        rotations: This many headings are tried over a full turn.
        max_candidates: This many of the best poses of all headings are refined.
        min_score: The best pose needs at least this score (0..1).
        min_margin: The best pose must exceed the score of every other place by this margin.

    Raises:
        InputError: A number is not positive.
    """

    first_search_m: float = 3.0
    retry_m: float = 0.5
    radius_m: float = 8.0
    min_cells: int = 30
    rotations: int = 90
    max_candidates: int = 12
    min_score: float = 0.4
    min_margin: float = 0.1


@dataclass(frozen=True)
class LocaliserParams:
    """Parameters of `Localiser`.

    Args:
        scan_interval_s: A scan is taken every so many seconds.
        settle_s: Scans before this time are added to the map without being matched.
        min_range_m: Shorter ranges are ignored.
        max_range_m: Longer ranges are ignored.
        cell_m: This is the side of an NDT cell; [Biber & Straßer 2003] use 1 m for a laser.
        map_cells: The map has this many cells along each side of its square, an even number.
        scale_sigma: This is the prior standard deviation of the scale error that odometry has after fusion.
        bend_sigma: This is the prior standard deviation of the turn error that odometry has after fusion.
        drift_sigma_rad_per_s: This is the prior standard deviation of the heading drift after fusion.
        information_scale: The information of a scan match is multiplied by this, as its points are not independent.
        min_sigma_m: No scan match counts as more precise than this position.
        min_sigma_rad: No scan match counts as more precise than this heading.
        min_score: Scan matches with a lower score are rejected (0..1).
        slip_gate: Odometry counts as slipping beyond this squared Mahalanobis distance of a scan match.
        loop_closure: Submaps are kept and loops closed; with False the state is one map, of some kilobytes.
        relocalisation: These parameters belong to the search in a known map.
        stereo: These parameters belong to the stereo search of a scan.
        odometry: These parameters belong to wheel and visual odometry.
        submaps: These parameters belong to submaps and loop closures.
        replay: These parameters belong to the replay of the scan log.

    Raises:
        InputError: A number is not positive, or the ranges or the number of cells cannot be used.
    """

    scan_interval_s: float = 0.2
    settle_s: float = 1.0
    min_range_m: float = 0.9
    max_range_m: float = 6.5
    cell_m: float = 0.25
    map_cells: int = 256
    scale_sigma: float = 0.003
    bend_sigma: float = 0.003
    drift_sigma_rad_per_s: float = math.radians(0.005)
    information_scale: float = 0.05
    min_sigma_m: float = 0.01
    min_sigma_rad: float = 0.006
    min_score: float = 0.1
    slip_gate: float = 16.0
    loop_closure: bool = True
    relocalisation: RelocalisationParams = field(default_factory=RelocalisationParams)
    stereo: SearchParams = field(default_factory=lambda: SearchParams(count=32, min_disparity_px=8))
    odometry: OdometryParams = field(default_factory=OdometryParams)
    submaps: SubmapParams = field(default_factory=SubmapParams)
    replay: ReplayParams = field(default_factory=ReplayParams)

    def __post_init__(self) -> None:
        check_numbers(self, positive=set(vars(self)) - {"settle_s", "loop_closure"})
        if not (self.min_range_m < self.max_range_m and self.map_cells % 2 == 0):
            raise InputError(f"expected min_range_m < max_range_m and an even number of map_cells, got {self}")

    @property
    def map_radius_m(self) -> float:
        """Half the side of the map, m."""
        return self.map_cells // 2 * self.cell_m
