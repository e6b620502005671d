"""Are the cameras all right? Asked before every step, because the navigator would believe anything."""

from __future__ import annotations

import math
from collections import deque

import torch
from torch import Tensor

from ndtorch.kernels.glance import BLOCK
from ndtorch.navigation import StereoRig, Strips, cut_strips
from ndtorch.navigation.rig import Rect
from ndtorch_robot.ports import StereoFrames
from ndtorch_robot.trouble import Kind, SightError
from ndtorch_robot.watching.agreement import PATCH, Agreement, partners
from ndtorch_robot.watching.eye import Eye, SightLimits, blindness, change, likeness, look, mixed
from ndtorch_robot.watching.one_floor import OneFloor
from ndtorch_robot.watching.turning import MOST, Turning
from ndtorch_robot.watching.witness import KEPT_WAYS, SLOWLY, Seen, left_behind, unchanged

NAMES = ("left", "right")

PATIENCE = 15
"""Frames in a row that must look wrong: half a second. One lost frame is no reason to stop."""

DARK = 0.012
"""A row of which no pixel is brighter is black: three levels of 256."""

MOVING = 0.1
"""Speed from which the picture must change, m/s."""

EVERY = 2
"""Frames of which one is looked into: half the work, and soon enough. After one that looks stuck the next one is."""

TURN = 0.08
"""Radians of a turn after which a picture is compared with one from before: eight blocks."""

TIGHT = 0.4
"""Radians to a meter from which a turn counts: in a wide one things beside the car go the other way."""

LIVELY = 30
"""Pictures of a standing car, one after the other, that must have differed before its camera is known to have noise."""

KEPT = 6
"""Pictures that are kept to compare with: 0.4 s at 30 frames a second."""

SHIFTS = 1.0
"""Seconds after a go in which wheels may turn that are said to stand: before reverse a board brakes for 0.3 s and waits
for 0.12 s, some motor controllers take that brake for reverse, and its pictures are kept for 0.4 s."""


class CameraWatch:
    """Raises `SightError` when frames cannot be trusted; the loop then stops the car.

    Noticed at once: a camera without a frame, times that do not increase, cameras that give frames of two
    sizes or kinds. After `patience` frames: a camera that sees black, and a camera whose picture stays the same
    to the bit while the car drives and the other camera's changes. Black is judged by the horizon row. The same
    is judged by the subfield, because floor that is seen must move; where a blank wall hides it nobody can say. While
    the car stands, a camera that had noise and has none any more.

    After `limits.patience_s` of pictures that look wrong (one that looks right takes one back): a camera that shows
    nothing or is blurred, both pictures moving while the wheels stand. Told the second time: a picture that hardly
    changes on a way on which it must. After some views on the way: cameras that are swapped, upside down or turned, by
    what both rows show and by the floor. After some sharp turns: one upside down, whose picture turns wrong.

    Args:
        rig: the camera pair.
        patience: frames in a row that must look wrong.
        together: two pictures that stay the same together are a fault as well. Not in a world that may stop.
        rate: frames a second.
        limits: what the pictures are judged by.
        floor: rectangles of both images that see the floor, where strips of them are given. With those both cameras
            must go on seeing one floor once they have, but for noise and walls.
    """

    def __init__(
        self,
        rig: StereoRig,
        patience: int = PATIENCE,
        together: bool = False,
        rate: float = 30.0,
        limits: SightLimits | None = None,
        floor: tuple[Rect, Rect] | None = None,
    ) -> None:
        self.rig, self.patience, self.fields = rig, patience, rig.subfields()
        self.together, self.rate, self.limits = together, rate, limits or SightLimits()
        self.wrong_for = max(2, round(self.limits.patience_s * rate / EVERY))
        self.agreement = Agreement(self.limits)
        self.floor = None if floor is None else OneFloor(rig, floor)
        self.turning = [Turning(rig.focal, self.limits) for _ in NAMES]
        self.compared_at = 0.0
        self.time = -math.inf
        self.last: list[Tensor | None] = [None, None]
        self.dark, self.frozen = [0, 0], [0, 0]
        self.lively = [0, 0]
        self.blind = [0, 0]
        self.stuck = [0, 0]
        self.carried = self.seen = 0
        self.driven = self.turned = 0.0
        self.wanted, self.shifts_until = 0.0, -math.inf
        self.before: deque[Seen] = deque(maxlen=KEPT)
        self.ways: deque[Seen] = deque(maxlen=KEPT_WAYS)

    def warm_up(self) -> None:
        """Have the kernels compiled or loaded, which may take seconds."""
        columns = self.rig.width // BLOCK
        picture = torch.arange(self.rig.width, dtype=torch.uint8).expand(1, 3, self.rig.height, -1)
        eye = look(cut_strips(picture, self.fields[0], self.rig))
        change(eye.row, eye.row)
        if columns > PATCH:
            partners(eye.row, eye.row, columns - PATCH, self.limits)
        if self.floor is not None:
            self.floor.warm_up()

    def check(self, frames: StereoFrames, speed: float, curvature: float = 0.0, wanted: float = 0.0) -> None:
        """Look at new frames.

        Args:
            speed, curvature: of the car since the last ones, m/s and 1/m.
            wanted: the speed that it was told.
        """
        if not frames.time > self.time:
            raise SightError(
                Kind.TIMES, f"times of frames must increase, got {frames.time:.3f} s after {self.time:.3f} s"
            )
        passed = min(frames.time - self.time, 0.5) if self.time > -math.inf else 0.0
        self.time = frames.time
        if wanted * self.wanted <= 0 and wanted != 0:
            self.shifts_until = self.time + SHIFTS
        self.wanted = wanted
        self.driven += abs(speed) * passed
        self.turned += speed * curvature * passed
        eyes = [self.strips(frames.left, 0), self.strips(frames.right, 1)]
        left, right = (eye.row for eye in eyes)
        if left.shape != right.shape or left.dtype != right.dtype:
            raise SightError(
                Kind.SHAPE,
                f"left and right frames must be alike, got rows of {left.dtype} {tuple(left.shape)} "
                f"and {right.dtype} {tuple(right.shape)}",
            )
        self.check_exactly(eyes, speed)
        self.seen += 1
        looked = self.seen % EVERY == 0 or any(self.stuck)
        if looked or 0 < abs(speed) < SLOWLY:
            pictures = look(eyes[0]), look(eyes[1])
            if looked:
                self.check_pictures(pictures, (eyes[0], eyes[1]))
            if speed != 0:
                self.ways.append((self.driven, self.turned, pictures))

    def check_exactly(self, eyes: list[Strips], speed: float) -> None:
        """Black, and the same to the bit: told soonest."""
        same = [old is not None and torch.equal(old, eye.field) for old, eye in zip(self.last, eyes, strict=True)]
        self.last = [eye.field for eye in eyes]
        for k, name in enumerate(NAMES):
            darkest = DARK * 255 if eyes[k].row.dtype == torch.uint8 else DARK
            alone = self.together or not same[1 - k]
            self.rest(k, same[k], speed)
            # Something must be in it: a blank wall that fills the subfield looks the same from everywhere. Asked last,
            # for it takes longest.
            tells = abs(speed) > MOVING or self.noisy(k)
            stuck = same[k] and alone and tells and mixed(eyes[k].field)
            self.dark[k] = self.dark[k] + 1 if float(eyes[k].row.max()) <= darkest else 0
            self.frozen[k] = self.frozen[k] + 1 if stuck else 0
            if self.dark[k] >= self.patience:
                raise SightError(Kind.BLACK, f"the {name} camera has seen nothing but black for {self.patience} frames")
            if self.frozen[k] >= self.patience:
                raise SightError(
                    Kind.FROZEN, f"the {name} camera has given the same picture for {self.patience} frames"
                )

    def rest(self, k: int, same: bool, speed: float) -> None:
        """Count pictures of a standing car that differ: what cannot move has changed, so its camera has noise."""
        if not self.noisy(k):
            self.lively[k] = 0 if same else self.lively[k] + (speed == 0)

    def noisy(self, k: int) -> bool:
        """A camera that has noise never gives the same picture again, whether the car drives, turns back or stands.

        Asked of real cameras alone. In a drawn world everything may stand still, and nothing has noise.
        """
        return self.together and self.lively[k] >= LIVELY

    def check_pictures(self, eyes: tuple[Eye, Eye], strips: tuple[Strips, Strips]) -> None:
        """What is in the pictures, against the way that the wheels say was driven."""
        reasons = [blindness(eye, self.limits) for eye in eyes]
        away = next((b for b in reversed(self.before) if self.far_from(b)), None)
        same = [unchanged(eyes[k], away[2][k], self.limits) if away is not None else False for k in (0, 1)]
        if all(same) and not self.together:
            same = [False, False]
        behind = [
            not same[k] and left_behind(eyes, k, self.ways, (self.driven, self.turned), self.limits) for k in (0, 1)
        ]
        for k, name in enumerate(NAMES):
            self.blind[k] = self.count(self.blind[k], reasons[k] is not None)
            # The same after so long a way, twice, is enough: the way counts, not the time that passed on it.
            by = (self.wrong_for + 1) // 2 if same[k] else 1
            self.stuck[k] = self.count(self.stuck[k], (same[k] or behind[k]) and reasons[k] is None, by)
            reason = reasons[k]
            if self.blind[k] >= self.wrong_for and reason is not None:
                raise SightError(reason.kind, f"the {name} camera {reason.words}")
            if self.stuck[k] >= self.wrong_for:
                if away is not None and not behind[k]:
                    what = f"after {1e3 * (self.driven - away[0]):.0f} mm driven"
                else:
                    what = f"while that of the {NAMES[1 - k]} one changes"
                raise SightError(Kind.FROZEN, f"the {name} camera shows the same picture {what}, but for noise")
        self.carried = self.count(self.carried, self.moved_by_others(eyes))
        if reasons == [None, None]:
            self.check_turning(eyes)
        self.before.append((self.driven, self.turned, eyes))
        if self.carried >= self.wrong_for:
            raise SightError(Kind.CARRIED, "both pictures move although the wheels stand")
        wrong = None
        if reasons == [None, None]:
            view, upright = (self.driven, self.turned), all(judge.upright for judge in self.turning)
            sure = self.floor is not None and self.floor.compare(*strips, view)
            wall = self.floor is not None and self.floor.wall
            wrong = self.agreement.compare(*eyes, view=view, upright=upright, sure=sure, wall=wall)
            if wrong is None and self.floor is not None and self.floor.lost:
                wrong = "both cameras do not see one floor any more: one is upside down or turned, or they are swapped"
        if wrong is not None:
            raise SightError(Kind.MOUNTING, wrong)

    def check_turning(self, eyes: tuple[Eye, Eye]) -> None:
        """Whether both pictures turn as the wheels say, after every piece of a sharp turn."""
        if abs(self.turned - self.compared_at) < TURN:
            return
        for driven, turned, old in reversed(self.before):
            turn = self.turned - turned
            if TURN <= abs(turn) <= MOST and abs(turn) >= TIGHT * (self.driven - driven):
                self.compared_at = self.turned
                wrong = [seen.compare(new, was, turn) for seen, new, was in zip(self.turning, eyes, old, strict=True)]
                if any(wrong):
                    which = "both cameras are" if all(wrong) else f"the {NAMES[wrong.index(True)]} camera is"
                    raise SightError(Kind.MOUNTING, f"{which} upside down: pictures turn the wrong way")
                return

    def forget(self) -> None:
        """Somebody says go, and may have put the cameras right: what was seen before tells nothing from here on."""
        # One that froze just before the stand shows almost the same when it is well again, as long as the car stands.
        self.before.clear()
        self.ways.clear()
        self.stuck = [0, 0]
        self.agreement.forget()
        if self.floor is not None:
            self.floor.forget()
        for judge in self.turning:
            judge.forget()

    def check_mounting(self, frames: StereoFrames) -> None:
        """Only whether both cameras show something, and lie the right way round, however the car is moved.

        Raises:
            SightError: what is wrong.
        """
        left, right = look(self.strips(frames.left, 0)), look(self.strips(frames.right, 1))
        for k, eye in enumerate((left, right)):
            reason = blindness(eye, self.limits)
            self.blind[k] = self.count(self.blind[k], reason is not None)
            if self.blind[k] >= self.wrong_for and reason is not None:
                raise SightError(reason.kind, f"the {NAMES[k]} camera {reason.words}")
        wrong = self.agreement.compare(left, right)
        if wrong is not None:
            raise SightError(Kind.MOUNTING, wrong)

    def count(self, before: int, wrong: bool, by: int = 1) -> int:
        """Pictures that look wrong, each as often as is said, less those that look right."""
        return min(before + by, self.wrong_for) if wrong else max(before - 1, 0)

    def far_from(self, before: Seen) -> bool:
        """Whether the car has since gone so far that every picture must have changed."""
        way, turn = self.driven - before[0], abs(self.turned - before[1])
        return way >= self.limits.moved_m or turn >= self.limits.turned_rad

    def moved_by_others(self, eyes: tuple[Eye, Eye]) -> bool:
        """Whether everything in both pictures has moved since the oldest of them, with the wheels at rest for sure."""
        if len(self.before) < KEPT or self.driven != self.before[0][0] or self.time < self.shifts_until:
            return False
        old = self.before[0][2]
        return all(
            likeness(new.row_shape, was.row_shape) < self.limits.still
            and likeness(new.field_shape, was.field_shape) < self.limits.still
            for new, was in zip(eyes, old, strict=True)
        )

    def strips(self, eye: Tensor | Strips | None, k: int) -> Strips:
        """The subfield and the horizon row of one camera."""
        if eye is None:
            raise SightError(Kind.MISSING, f"the {NAMES[k]} camera gave no frame")
        if isinstance(eye, Strips):
            return eye
        if tuple(eye.shape[-2:]) != (self.rig.height, self.rig.width):
            raise SightError(
                Kind.SHAPE,
                f"the {NAMES[k]} camera gives {eye.shape[-1]}x{eye.shape[-2]} frames, "
                f"{self.rig.width}x{self.rig.height} are wanted",
            )
        return cut_strips(eye, self.fields[k], self.rig)
