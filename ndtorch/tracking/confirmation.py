"""Confirmation: when a tentative track becomes an object, and when that is revoked."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ndtorch.foreground.arrays import Bytes, Floats, Numbers
from ndtorch.tracking.clutter import CLUTTER_LEVEL, clutter_at, is_particle_clutter
from ndtorch.tracking.params import TrackingParams
from ndtorch.tracking.rigid_motion import (
    has_contrast,
    is_rigid_motion,
    revoke_confirmation,
)
from ndtorch.tracking.track import Track, TrackState

LEARNING_S = 1.0
"""No track is confirmed within this many seconds of a scene's beginning."""
MAX_SHADOW = 0.5
"""A track of which this share, in the mean, may be a narrow shadow is one."""


def confirm(
    tracks: Sequence[Track],
    lost: Sequence[Track],
    clutter: Floats,
    swinging: Bytes,
    births: Numbers,
    light: Callable[[], float],
    time: float,
    seen_for: float,
    dt: float,
    width: float,
    p: TrackingParams,
) -> None:
    """Confirm tentative tracks, and revoke confirmations; their states are changed.

    Args:
        tracks: those that go on; lost: those that ended at this step.
        clutter, births: of `ndtorch.tracking.clutter`, a step ago.
        swinging: 1 where something swings, `[h / 2, w / 2]`.
        light: gives the mean of the background: it is seldom asked for, and the same for all tracks.
        seen_for: seconds since the scene began.
        dt: seconds of a step.
        width: of the image in heights.
    """
    for one in tracks:
        if one.last_seen != time:
            continue
        if one.is_object:
            if revoke_confirmation(one, clutter, swinging, time, dt, p):
                one.state = TrackState.TENTATIVE
        elif (
            seen_for > LEARNING_S - dt / 2
            and travels_enough(one, clutter, p)
            and not is_shadow(one)
            and is_object(one, light, p)
            and not is_particle_clutter(one, births, seen_for, width, p)
        ):
            one.state, one.confirmed_at = TrackState.CONFIRMED, time if one.confirmed_at < 0 else one.confirmed_at
    for one in (*tracks, *lost):
        # It may be that the other particles came later.
        young = one.is_object and one.last_seen - one.confirmed_at < p.probation_s
        if young and is_particle_clutter(one, births, seen_for, width, p):
            one.state = TrackState.TENTATIVE


def min_travel(track: Track, p: TrackingParams) -> float:
    """Distance that a track has to move. Noise, leaves and a codec's blocks wander by more than their own size."""
    if not p.min_travel_sizes:
        return 0.0
    return max(p.min_travel_sizes * track.size, p.min_travel_height_ratio)


def travels_enough(track: Track, clutter: Floats, p: TrackingParams) -> bool:
    """Whether a track was in sight for long enough and moved far enough: further in clutter."""
    enough, far = min_travel(track, p), track.net_travel
    if far < enough or track.age < p.min_track_s:
        return False
    return far >= (p.clutter_travel_factor * enough if clutter_at(track, clutter) >= CLUTTER_LEVEL else enough)


def is_object(track: Track, light: Callable[[], float], p: TrackingParams) -> bool:
    """Whether a track has contrast, or moves rigidly. Everything is an object if `min_travel_sizes` is 0."""
    return not p.min_travel_sizes or has_contrast(track, p) or is_rigid_motion(track, float(light()))


def is_shadow(track: Track) -> bool:
    """Whether a track was, in all its detections together, hardly more than a narrow shadow."""
    return track.shadow_sum >= MAX_SHADOW * track.count
