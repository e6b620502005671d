"""The camera monitor: raises `CameraError` when the frames of the cameras cannot be trusted."""

from __future__ import annotations

import math
from collections import deque

import torch
from torch import Tensor

from ndtorch.navigation import StereoRig, Strips, cut_strips
from ndtorch.navigation.stereo.rig import Rect
from ndtorch_robot.camera_monitor.image_quality import Snapshot, change, check_image, correlation, has_moved, measure
from ndtorch_robot.camera_monitor.limits import CameraLimits
from ndtorch_robot.camera_monitor.motion_check import MAX_TURN, FlowDirectionCheck, View, is_frozen, is_unchanged
from ndtorch_robot.camera_monitor.mounting_check import PATCH, MountingCheck, correlations
from ndtorch_robot.camera_monitor.stereo_consistency import StereoConsistency
from ndtorch_robot.faults import CameraError, FaultKind
from ndtorch_robot.ports import StereoFrames

NAMES = ("left", "right")

PATIENCE = 15
"""Frames in a row that must look wrong: half a second. One lost frame is no reason to stop."""

DARK = 0.012
"""A row is black when no pixel is brighter: three levels of 256."""

MOVING = 0.1
"""Speed from which the image must change, m/s."""

EVERY = 2
"""One of this many frames is analysed; after one that looks frozen the next one is, too."""

TURN = 0.08
"""Turn after which an image is compared with an earlier one, radians: eight blocks."""

TIGHT = 0.4
"""Radians per metre from which a turn counts: in a wide one objects beside the car move the other way."""

NOISY = 30
"""Consecutive images of a stationary car that must have differed before its camera is known to have noise."""

KEPT = 6
"""Analysed views that are kept: 0.4 s at 30 frames a second."""

KEPT_MOVING = 8
"""Views of the moving car that are kept, however long it then stands."""

SLOW = 0.3
"""Speed below which every view of a moving car is kept, m/s: a car that stops shows few."""

GEAR_CHANGE = 1.0
"""Seconds after a change of the commanded direction in which wheels may turn that are reported to stand: before reverse
a board brakes for 0.3 s and waits for 0.12 s, some motor controllers take that brake for reverse, and its images are
kept for 0.4 s."""


class CameraMonitor:
    """Raises `CameraError` when frames cannot be trusted; the loop then stops the car.

    At once: a camera without a frame, times that do not increase, frames of two sizes or types. After `patience`
    frames: a camera that sees black (judged by the horizon row), and a camera whose image stays equal to the bit while
    the car drives and the other camera's changes (judged by the subfield, because visible floor must move), or while
    the car stands, of a camera that is known to have noise.

    After `limits.patience_s` of images that look wrong, where one that looks right cancels one: a camera that shows
    nothing or is blurred, and both images moving while the wheels stand. At the second detection: an image that hardly
    changes over a distance on which it must. After several views: cameras that are swapped, upside down or turned, by
    both rows and by the floor. After several sharp turns: an upside-down camera, whose image turns the wrong way.

    Args:
        rig: the camera pair.
        patience: frames in a row that must look wrong.
        joint_freeze: two images that freeze together are a fault as well. Not in a simulation that may stop.
        rate: frames a second.
        limits: see `CameraLimits`.
        floor: rectangles of both images that see the floor, where strips of them are given. Both cameras must go on
            seeing one floor once they have, except for noise and walls.
    """

    def __init__(
        self,
        rig: StereoRig,
        patience: int = PATIENCE,
        joint_freeze: bool = False,
        rate: float = 30.0,
        limits: CameraLimits | None = None,
        floor: tuple[Rect, Rect] | None = None,
    ) -> None:
        self.rig, self.patience, self.fields = rig, patience, rig.subfields()
        self.joint_freeze, self.limits = joint_freeze, limits or CameraLimits()
        self.required = max(2, round(self.limits.patience_s * rate / EVERY))
        self.mounting = MountingCheck(self.limits)
        self.floor = None if floor is None else StereoConsistency(rig, floor)
        self.flow = [FlowDirectionCheck(rig.focal, self.limits) for _ in NAMES]
        self.time = self.gear_change_until = -math.inf
        self.last: list[Tensor | None] = [None, None]
        self.black, self.equal, self.differing, self.blind, self.frozen = ([0, 0] for _ in range(5))
        self.moved_by_others = self.frames = 0
        self.driven = self.turned = self.commanded = self.flow_checked_at = 0.0
        self.views: deque[View] = deque(maxlen=KEPT)
        self.moving_views: deque[View] = deque(maxlen=KEPT_MOVING)

    def warm_up(self) -> None:
        """Compile or load the kernels, which may take seconds."""
        ramp = torch.arange(self.rig.width, dtype=torch.uint8).expand(1, 3, self.rig.height, -1)
        image = measure(cut_strips(ramp, self.fields[0], self.rig))
        change(image.row, image.row)
        change(image.field, image.field)
        if len(image.row) > PATCH:
            correlations(image.row, image.row, len(image.row) - PATCH, self.limits)
        if self.floor is not None:
            self.floor.warm_up()

    def reset(self) -> None:
        """Drop the history: a person resumes the car, and may have corrected the cameras."""
        # A camera that froze just before the stop shows almost the same when it is well again, while the car stands.
        self.views.clear()
        self.moving_views.clear()
        self.frozen = [0, 0]
        self.mounting.reset()
        if self.floor is not None:
            self.floor.reset()
        for check in self.flow:
            check.reset()

    def check(self, frames: StereoFrames, speed: float, curvature: float = 0.0, commanded: float = 0.0) -> None:
        """Raise `CameraError` where new frames are wrong; speed and curvature (m/s, 1/m) are of the car since the last
        ones, `commanded` is what it was sent.
        """
        self.update_odometry(frames.time, speed, curvature, commanded)
        strips = self.strips(frames.left, 0), self.strips(frames.right, 1)
        left, right = (each.row for each in strips)
        if left.shape != right.shape or left.dtype != right.dtype:
            words = " and ".join(f"{row.dtype} {tuple(row.shape)}" for row in (left, right))
            raise CameraError(FaultKind.SHAPE, f"left and right frames must be alike, got rows of {words}")
        self.check_pixels(strips, speed)
        self.frames += 1
        due = self.frames % EVERY == 0 or any(self.frozen)
        if due or 0 < abs(speed) < SLOW:
            images = measure(strips[0]), measure(strips[1])
            if due:
                self.check_images(images, strips)
            if speed != 0:
                self.moving_views.append(View(self.driven, self.turned, images))

    def check_mounting(self, frames: StereoFrames) -> None:
        """Check only whether both cameras show something and are mounted correctly, however the car is moved."""
        images = measure(self.strips(frames.left, 0)), measure(self.strips(frames.right, 1))
        self.check_shown(images)
        wrong = self.mounting.compare(*images)
        if wrong is not None:
            raise CameraError(FaultKind.MOUNTING, wrong)

    def update_odometry(self, time: float, speed: float, curvature: float, commanded: float) -> None:
        if not time > self.time:
            words = f"times of frames must increase, got {time:.3f} s after {self.time:.3f} s"
            raise CameraError(FaultKind.TIMES, words)
        passed = min(time - self.time, 0.5) if self.time > -math.inf else 0.0
        self.time = time
        if commanded * self.commanded <= 0 and commanded != 0:
            self.gear_change_until = time + GEAR_CHANGE
        self.commanded = commanded
        self.driven += abs(speed) * passed
        self.turned += speed * curvature * passed

    def check_pixels(self, strips: tuple[Strips, Strips], speed: float) -> None:
        """Black, and equal to the bit: the fastest checks."""
        same = [old is not None and torch.equal(old, new.field) for old, new in zip(self.last, strips, strict=True)]
        self.last = [each.field for each in strips]
        for k, name in enumerate(NAMES):
            darkest = DARK * 255 if strips[k].row.dtype == torch.uint8 else DARK
            alone = self.joint_freeze or not same[1 - k]
            if not self.has_noise(k):
                self.differing[k] = 0 if same[k] else self.differing[k] + (speed == 0)
            must_change = abs(speed) > MOVING or self.has_noise(k)
            equal = same[k] and alone and must_change
            if equal:  # a blank wall that fills the subfield looks the same from everywhere
                field = strips[k].field
                equal = bool((field.amax((-2, -1)) > field.amin((-2, -1))).any())
            self.black[k] = self.black[k] + 1 if float(strips[k].row.max()) <= darkest else 0
            self.equal[k] = self.equal[k] + 1 if equal else 0
            for count, kind, words in (
                (self.black[k], FaultKind.BLACK, "seen nothing but black"),
                (self.equal[k], FaultKind.FROZEN, "given the same image"),
            ):
                if count >= self.patience:
                    raise CameraError(kind, f"the {name} camera has {words} for {self.patience} frames")

    def has_noise(self, k: int) -> bool:
        """Whether a camera never gives the same image twice while the car stands; rendered images do."""
        return self.joint_freeze and self.differing[k] >= NOISY

    def check_shown(self, images: tuple[Snapshot, Snapshot]) -> list[bool]:
        """Which cameras show something; raises `CameraError` for one that has not for long enough."""
        faults = [check_image(image, self.limits) for image in images]
        for k, fault in enumerate(faults):
            self.blind[k] = self.count(self.blind[k], fault is not None)
            if fault is not None and self.blind[k] >= self.required:
                raise CameraError(fault.kind, f"the {NAMES[k]} camera {fault.message}")
        return [fault is None for fault in faults]

    def check_images(self, images: tuple[Snapshot, Snapshot], strips: tuple[Strips, Strips]) -> None:
        shows, limits = self.check_shown(images), self.limits
        far = next((view for view in reversed(self.views) if self.far_from(view)), None)
        same = [far is not None and is_unchanged(images[k], far.images[k], limits) for k in (0, 1)]
        if all(same) and not self.joint_freeze:
            same = [False, False]
        here = (self.driven, self.turned)
        behind = [not same[k] and is_frozen(images, k, self.moving_views, here, limits) for k in (0, 1)]
        for k, name in enumerate(NAMES):
            # The same image twice after that distance is enough: the distance counts, not the time.
            weight = (self.required + 1) // 2 if same[k] else 1
            self.frozen[k] = self.count(self.frozen[k], (same[k] or behind[k]) and shows[k], weight)
            if self.frozen[k] >= self.required:
                when = f"while that of the {NAMES[1 - k]} one changes"
                if far is not None and not behind[k]:
                    when = f"after {1e3 * (self.driven - far.driven):.0f} mm driven"
                raise CameraError(FaultKind.FROZEN, f"the {name} camera shows the same image {when}, but for noise")
        self.moved_by_others = self.count(self.moved_by_others, self.moves_while_stopped(images))
        if all(shows):
            self.check_flow_direction(images)
        self.views.append(View(*here, images))
        if self.moved_by_others >= self.required:
            raise CameraError(FaultKind.MOVED_WHILE_STOPPED, "both images move although the wheels stand")
        if all(shows):
            self.compare_cameras(images, strips)

    def compare_cameras(self, images: tuple[Snapshot, Snapshot], strips: tuple[Strips, Strips]) -> None:
        """Check by both rows and by the floor that the cameras are mounted correctly."""
        position, floor = (self.driven, self.turned), self.floor
        same_floor = floor is not None and floor.compare(*strips, position)
        wrong = self.mounting.compare(
            *images,
            position,
            upright=all(check.upright for check in self.flow),
            same_floor=same_floor,
            near_wall=floor is not None and floor.near_wall,
        )
        if wrong is None and floor is not None and floor.swapped:
            wrong = "the cameras are swapped: both show one floor with their images exchanged"
        if wrong is None and floor is not None and floor.lost:
            wrong = "both cameras do not see one floor any more: one is upside down or turned, or they are swapped"
        if wrong is not None:
            raise CameraError(FaultKind.MOUNTING, wrong)

    def check_flow_direction(self, images: tuple[Snapshot, Snapshot]) -> None:
        """Check after every part of a sharp turn whether both images turn as the wheels say."""
        if abs(self.turned - self.flow_checked_at) < TURN:
            return
        for driven, turned, old in reversed(self.views):
            turn = self.turned - turned
            if TURN <= abs(turn) <= MAX_TURN and abs(turn) >= TIGHT * (self.driven - driven):
                self.flow_checked_at = self.turned
                wrong = [check.compare(new, was, turn) for check, new, was in zip(self.flow, images, old, strict=True)]
                if any(wrong):
                    which = "both cameras are" if all(wrong) else f"the {NAMES[wrong.index(True)]} camera is"
                    raise CameraError(FaultKind.MOUNTING, f"{which} upside down: images turn the wrong way")
                return

    def count(self, before: int, wrong: bool, weight: int = 1) -> int:
        return min(before + weight, self.required) if wrong else max(before - 1, 0)

    def far_from(self, view: View) -> bool:
        """Whether every image must have changed since a view."""
        moved, turned = self.driven - view.driven, abs(self.turned - view.turned)
        return moved >= self.limits.moved_m or turned >= self.limits.turned_rad

    def moves_while_stopped(self, images: tuple[Snapshot, Snapshot]) -> bool:
        """Whether both images have moved as a whole since the oldest view, with the wheels certainly at rest."""
        if len(self.views) < KEPT or self.driven != self.views[0].driven or self.time < self.gear_change_until:
            return False
        limit = self.limits.static_correlation
        return all(
            correlation(new.field_detail, was.field_detail) < limit and has_moved(new.row_detail, was.row_detail, limit)
            for new, was in zip(images, self.views[0].images, strict=True)
        )

    def strips(self, image: Tensor | Strips | None, k: int) -> Strips:
        if image is None:
            raise CameraError(FaultKind.MISSING, f"the {NAMES[k]} camera gave no frame")
        if isinstance(image, Strips):
            return image
        (high, wide), rig = image.shape[-2:], self.rig
        if (high, wide) != (rig.height, rig.width):
            words = f"gives {wide}x{high} frames, {rig.width}x{rig.height} are wanted"
            raise CameraError(FaultKind.SHAPE, f"the {NAMES[k]} camera {words}")
        return cut_strips(image, self.fields[k], self.rig)
