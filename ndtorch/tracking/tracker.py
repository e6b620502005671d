"""The tracker: blobs of one frame -> tracks, in stages."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ndtorch.foreground.arrays import Bools, Bytes, Floats, Labels
from ndtorch.foreground.segmentation import Segmentation
from ndtorch.tracking._kernels_blobs import rename
from ndtorch.tracking.association import Association, assign_unmatched, associate, share_blob
from ndtorch.tracking.blobs import Blobs
from ndtorch.tracking.clutter import BIRTH, empty_clutter_map, recent_births, update_clutter_map
from ndtorch.tracking.color_names import WhiteBalance
from ndtorch.tracking.confirmation import confirm
from ndtorch.tracking.ghosts import GHOST, recent_ghosts, trace_back
from ndtorch.tracking.masks import Detection, marked_share, measure_detections, object_mask, share_pixels
from ndtorch.tracking.params import TrackingParams
from ndtorch.tracking.rigid_motion import update_appearance_match
from ndtorch.tracking.split_merge import resolve_splits
from ndtorch.tracking.track import (
    MOVED_SIZES,
    PARKED_S,
    PIXELS,
    PLACE,
    QUIET_S,
    Rows,
    Track,
    TrackState,
    TrackTable,
    is_kept_from_background,
    is_small,
    split_lost,
    stands,
    table_from_tracks,
    tracks_from_table,
    update_stationary,
)

EDGE = 0.003
"""A box nearer to the edge of the image than this fraction of its height touches it."""
NEVER_S = -1e6
"""A time before all others."""
MAX_GHOST_RATIO = 0.8
"""What splits off an object differs from it by less than this share of its difference from the background: a ghost
differs as much from both."""
OCCLUSION_GAIN = 0.3
"""In a shared blob this share of the difference is taken into the place."""


class TrackerState(NamedTuple):
    """State of the tracker; its parts are arrays, or tensors in the state of a model.

    Attributes:
        tracks: that go on.
        labels: number of the track of every pixel plus one, 0 for none, `[h, w]` int32.
        clutter: how many tracks came and went at each place without becoming objects, `[rows, columns]` float32.
        births: tracks that began lately, see `BIRTH`; ghosts: those found lately, see `GHOST`.
        passed: time at which an object, or a ghost, was last at each pixel, long ago if none was, `[h, w]` float32.
        count: tracks begun, int64 scalar.
    """

    tracks: TrackTable
    labels: Any
    clutter: Any
    births: Rows
    ghosts: Rows
    passed: Any
    count: Any


class Tracker:
    """Follows blobs from frame to frame: a `TrackerState` in a list and arrays, which each step changes.

    Args:
        state: left as it is.
        dt: seconds of a step.
        params: constants.
    """

    def __init__(self, state: TrackerState, dt: float, params: TrackingParams) -> None:
        self.dt, self.params = dt, params
        self.load(state)

    def load(self, state: TrackerState) -> None:
        """Go on from a state."""
        self.tracks, self.count = tracks_from_table(state.tracks), int(state.count)
        # What no step changes is copied: an array of a tensor keeps it alive, and so all states before.
        self.clutter, self.passed = np.asarray(state.clutter).copy(), np.asarray(state.passed).copy()
        self.births, self.ghosts = np.asarray(state.births.rows).copy(), np.asarray(state.ghosts.rows).copy()
        self.labels = np.asarray(state.labels)
        self.closed = list[Track]()

    @staticmethod
    def start(height: int, width: int, count: int = 0) -> TrackerState:
        """No tracks, for images of so many pixels."""
        labels, clutter = np.zeros((height, width), np.int32), empty_clutter_map(height, width)
        passed = np.full((height, width), NEVER_S, np.float32)
        births, ghosts = (Rows(np.zeros((0, numbers))) for numbers in (BIRTH, GHOST))
        return TrackerState(table_from_tracks([]), labels, clutter, births, ghosts, passed, np.array(count, np.int64))

    def state(self) -> TrackerState:
        """The present state, which shares the memory."""
        tracks, count = table_from_tracks(self.tracks), np.array(self.count, np.int64)
        rows = Rows(self.births), Rows(self.ghosts)
        return TrackerState(tracks, self.labels, self.clutter, *rows, self.passed, count)

    def end_all(self) -> list[Track]:
        """End all tracks, as at a scene cut; returns the objects among them."""
        ended = [one for one in self.tracks if one.is_object]
        height, width = self.labels.shape
        self.load(self.start(height, width, self.count))
        for one in ended:
            one.state = TrackState.LOST
        return ended

    def moving(self, time: float) -> Bytes:
        """1 for the numbers, plus one, of objects that move, `[count + 1]`; stationary ones are found at that time."""
        update_stationary(self.tracks, time, self.params)
        marks = np.zeros(self.count + 1, np.uint8)
        marks[[one.number + 1 for one in self.tracks if one.state == TrackState.CONFIRMED]] = 1
        return marks

    def update(self, blobs: Blobs, seen: Segmentation, light: WhiteBalance, time: float, seen_for: float) -> None:
        """One step: every track to the blob that fills most of its expected box, the rest by distance and color.

        A blob of several objects is shared: each of its pixels goes to the track whose box is nearest, in sizes of that
        box, and whose color is most alike. When they split, place, color and size say who is who. Other blobs inside a
        track's expected box are fragments of it. What is left begins a track.

        Args:
            seen, light: segmentation and white balance of this frame.
            time: seconds, and seen_for: seconds since the scene began.
        """
        p, height, width = self.params, *blobs.labels.shape
        tracks, lost = split_lost(self.tracks, time, self.dt, p)
        found = associate(tracks, time, blobs, p)
        resolve_splits(tracks, found, blobs, seen.image, time, p)
        assign_unmatched(tracks, found, blobs, seen.image, time, p)
        before = self.labels
        groups, parts = self.label(tracks, found, blobs, seen.image, time)
        shared = {one.number for _, ones in groups for one in ones}
        self.measure(tracks, seen, light, shared, before, time, width / height)
        confirm(
            tracks,
            lost,
            self.clutter,
            seen.swinging,
            self.births,
            cache(seen.background.mean),
            time,
            seen_for,
            self.dt,
            width / height,
            p,
        )
        self.tracks = [one for one in tracks if one.number not in parts]
        self.births = recent_births(self.births, self.tracks, lost, time, p)
        self.clutter = update_clutter_map(self.clutter, lost, self.tracks, self.dt, p)
        for one in lost:
            one.state = TrackState.LOST if one.is_object else one.state
        earlier = [part for one in self.tracks if (part := one.close_earlier()) is not None]
        self.closed = [one for one in (*earlier, *lost) if one.is_object]

    def label(
        self, tracks: list[Track], found: Association, blobs: Blobs, image: Floats, time: float
    ) -> tuple[list[tuple[int, list[Track]]], set[int]]:
        """Label the pixels of every track, and begin tracks, which are added, for blobs that are left.

        Returns:
            The shared blobs with their tracks, and numbers of tracks that turned out to be parts of others.
        """
        p, height = self.params, blobs.labels.shape[0]
        owners = np.zeros(len(blobs.areas) + 1, np.int32)
        groups, absorbed = list[tuple[int, list[Track]]](), set[int]()
        for r in range(len(blobs.areas)):
            visible, hidden, parts = share_blob([tracks[k] for k in found.tracks[r]], blobs.areas[r] / height**2, p)
            absorbed |= {one.number for one in parts}
            # What one that hides others looks like by itself is not seen.
            if len(visible) > 1 or hidden:
                groups.append((r, visible))
            elif visible:
                owners[r + 1] = visible[0].number + 1
            elif r in found.fragments:
                owners[r + 1] = tracks[found.fragments[r]].number + 1
            else:
                box = blobs.boxes[r]
                place = (float(box[0] + box[2]) / 2 / height, float(box[1] + box[3]) / 2 / height)
                tracks.append(Track.begin(self.count, time, place))
                self.count += 1
                owners[r + 1] = self.count
        self.labels = np.empty_like(blobs.labels)
        rename(blobs.labels, owners, self.labels)
        for r, ones in groups:
            share_pixels(self.labels, blobs.labels, r, blobs.boxes[r], ones, time, image, p)
        return groups, absorbed

    def measure(
        self,
        tracks: Sequence[Track],
        seen: Segmentation,
        light: WhiteBalance,
        shared: set[int],
        before: Labels,
        time: float,
        width: float,
    ) -> None:
        """Measure the masks, and update each track that has one; `before` are the labels of a step ago."""
        p, every = self.params, measure_detections(tracks, self.labels, seen, light, shared)
        tentative = any(not one.is_object for one in tracks)
        shadows = marked_share(self.labels, seen.narrow_shadow, tracks) if tentative else np.zeros(len(tracks))
        for one, detection, shadow in zip(tracks, every, shadows.tolist(), strict=True):
            if detection is None:
                continue
            large = detection.pixels >= p.min_area_ratio * width
            if not one.is_object and large and one.count and is_small(one, width, p):
                # All before was a fragment of it.
                one.restart(time, detection.place)
            if not one.count:
                window = detection.window(len(self.labels))
                own = self.labels[window] == one.number + 1
                one.passed_at = lower_quartile(self.passed[window][own])
                whole = split_from(tracks, every, before[window][own], detection, seen.background[:, *window], own, p)
                one.start = one.start if whole is None else whole.start
            add_detection(one, time, detection, width, p)
            if not one.is_object and not detection.shared:
                one.contrast_sum += detection.contrast
                one.shadow_sum += shadow
                update_appearance_match(one, seen.image, seen.background)

    def trace_back(self, ghost: Bools | None, first: Floats, seen: Segmentation, time: float, seen_for: float) -> None:
        """Assign ghosts, with those of a mask `[h, w]`, to the objects that they are of.

        Args:
            first: image of the scene, `[3, h, w]`, and seen: segmentation of this frame.
            time: seconds, and seen_for: seconds since the scene began.
        """
        if ghost is not None:
            self.ghosts = recent_ghosts(self.ghosts, ghost, first, seen, time)
            self.passed[ghost] = time
        if len(self.ghosts):
            self.ghosts = trace_back(self.ghosts, self.tracks, time - seen_for, time, self.params)

    def object_mask(self, time: float, kept: Floats) -> Bytes:
        """1 where objects are, 0 elsewhere, `[h, w]`; `kept` becomes 1 where the background is not learned, 3 where
        its noise is neither."""
        width = self.labels.shape[1] / self.labels.shape[0]
        # Others have no pixels.
        seen = [one for one in self.tracks if one.last_seen == time]
        objects = [one.number for one in seen if one.is_object]
        keep = [one for one in seen if is_kept_from_background(one, time, width, self.params)]
        quiet = [one.number for one in keep if stands(one, time, QUIET_S)]
        mask = object_mask(self.labels, objects, [one.number for one in keep], quiet, self.count, kept)
        if objects:
            np.copyto(self.passed, np.float32(time), where=mask.view(np.bool_))
        return mask


def lower_quartile(values: Floats) -> float:
    """A quarter of the values are below it."""
    values.sort()
    at, share = divmod(len(values) - 1, 4)
    low, high = values[at : at + 2].tolist() if share else 2 * [float(values[at])]
    return float(low + (high - low) * share / 4)


def split_from(
    tracks: Sequence[Track],
    every: Sequence[Detection | None],
    before: Labels,
    new: Detection,
    background: Floats,
    own: Bools,
    p: TrackingParams,
) -> Track | None:
    """The object that a new track came off: most of its pixels were of it, it is no small fragment of it, and it looks
    more like it than like the background, as no ghost does.

    Args:
        every: detections of the tracks at this step.
        before: numbers, plus one, of the tracks that its pixels were of a step ago, `[n]`.
        background: `[3, h, w]`, and own: its pixels, `[h, w]`, in its box.
    """
    most = int(np.bincount(before).argmax()) - 1
    for one, seen in zip(tracks, every, strict=True):
        if one.number == most and one.is_object and seen and p.parent_area_ratio * new.pixels > seen.pixels:
            ghost = np.abs(new.color - background[:, own].mean(1)).max()
            return one if np.abs(new.color - seen.color).max() < MAX_GHOST_RATIO * ghost else None
    return None


def add_detection(track: Track, time: float, seen: Detection, across: float, p: TrackingParams) -> None:
    """Take a detection in an image so many heights across. In a shared blob the size is remembered, not measured,
    and so is the place of a parked one, and of a stationary one that something covers.

    To grow is not to travel: a tentative track that is much larger at once, as a screen after a cut, begins its path
    anew. What touches the edge of the image may be coming in.
    """
    (row, column), (tall, wide), pixels = seen.place, seen.extent, seen.pixels
    track.shades = track.shades + seen.shades
    if track.count:
        gap = time - track.last_seen
        there, down, extent = track.expected(time, p.max_prediction_s), track.velocity, track.extent
        standing = track.state == TrackState.STATIONARY
        if seen.shared or (standing and pixels > p.parent_area_ratio * track.last[PIXELS]):
            pixels, (tall, wide) = track.last[PIXELS], extent
            near = math.dist((row, column), track.last[PLACE]) < MOVED_SIZES * track.size
            if not seen.shared or (near and stands(track, time, PARKED_S)):
                row, column = track.last[PLACE]
                there = row, column
            row, column = there[0] + OCCLUSION_GAIN * (row - there[0]), there[1] + OCCLUSION_GAIN * (column - there[1])
        else:
            if not track.is_object and pixels > p.max_area_ratio * track.last[PIXELS]:
                room = min(row - tall / 2, column - wide / 2, 1 - row - tall / 2, across - column - wide / 2)
                track.start = track.start if room < EDGE else (row, column)
            keep = gap / (p.tau_size + gap)
            track.extent = extent[0] + keep * (tall - extent[0]), extent[1] + keep * (wide - extent[1])
            track.color = track.color + keep * (seen.color - track.color)
        # Of a young track the mean of all steps so far.
        pace, span = max(gap / (p.tau_velocity + gap), 1 / track.count), max(gap, 1e-9)
        track.velocity = down[0] + pace * (row - there[0]) / span, down[1] + pace * (column - there[1]) / span
    else:
        track.extent, track.color = (tall, wide), seen.color
    if math.dist((row, column), track.anchor) > MOVED_SIZES * track.size:
        track.last_moved, track.anchor = time, (row, column)
    box = row - tall / 2, column - wide / 2, row + tall / 2, column + wide / 2
    track.new_detections.append((time, *seen.inner, *box, pixels, row, column))
