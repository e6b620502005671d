"""Video as moving layers over a still ground: a sprite for each object, found by its color or by its motion.

Every pixel belongs to the ground or to one sprite. A sprite is an image and a mask that move by whole pixels from
frame to frame (layered representation: Wang & Adelson 1994; flexible sprites: Jojic & Frey 2001). Where one color fills
much of the image, that color is the ground. Otherwise the ground is what has stayed the same, and the first sprites are
what one displacement explains. Parts that move alike and touch are one object (common fate).

NumPy, for small images: a step takes time in proportion to pixels x sprites.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ndtorch.errors import InputError
from ndtorch.tracking.regions import (
    Floats,
    Image,
    Labels,
    Mask,
    Shift,
    color_parts,
    commonest_color,
    half_pixel_bounds,
    misfit,
    moved_parts,
    shifted,
)


@dataclass(frozen=True)
class LayerParams:
    """Constants of `Layers`. Colors are 0 to 255, lengths are pixels.

    Attributes:
        same_color: Two colors are the same if no channel differs by more than this.
        ground_ratio: One color is the ground if it fills at least this fraction of the image.
        static_frames: What has not changed for this many frames is ground, unless a sprite covers it.
        min_area_px: A new sprite has at least this area.
        max_misfit: A pixel costs at most this, in grey levels.
        accept_ratio: A pixel is of a sprite if it costs less than this fraction of `max_misfit`.
        margin_ratio: A pixel outside the mask costs this fraction of `max_misfit` for each pixel of distance.
        max_shift_px: A new sprite is searched within this distance; later ones within 2 of their velocity.
        rim_ratio: A part of one color moves if these fractions of its inner and outer rim changed, summed.
        same_velocity_px: Sprites that touch are one if their velocities differ by less than this a frame.
        confirm_path_px: A sprite that is found later is confirmed once it has moved this far.
        confirm_misfit_ratio: It is confirmed while its mean cost is below this fraction of `max_misfit`.
        max_lost_frames: A sprite that is hidden for longer is dropped.
    """

    same_color: int = 4
    ground_ratio: float = 0.3
    static_frames: int = 2
    min_area_px: int = 12
    max_misfit: float = 24.0
    accept_ratio: float = 0.6
    margin_ratio: float = 0.2
    max_shift_px: int = 4
    rim_ratio: float = 0.5
    same_velocity_px: float = 1.2
    confirm_path_px: float = 2.0
    confirm_misfit_ratio: float = 0.25
    max_lost_frames: int = 3


class Sprite(NamedTuple):
    """One object.

    Attributes:
        label: its number in the labels, from 1.
        mask: where it is, hidden pixels included, `[H, W]`.
        image: how it looks there, `[H, W, 3]`.
        velocity: rows and columns a frame.
        shift: of the last frame.
        age: frames since it was found.
        lost: frames for which nothing of it was seen.
        path: length of its path, pixels.
        misfit: mean cost of its pixels, as a fraction of `max_misfit`.
        confirmed: whether it is reported.
    """

    label: int
    mask: Mask
    image: Image
    velocity: tuple[float, float] = (0.0, 0.0)
    shift: Shift = (0, 0)
    age: int = 0
    lost: int = 0
    path: float = 0.0
    misfit: float = 0.0
    confirmed: bool = True


class LayersState(NamedTuple):
    """What `Layers` remembers.

    Attributes:
        frames: how many were seen.
        before: the last one, `[H, W, 3]`.
        ground: color of the ground where it is known, `[H, W, 3]`.
        known: where that is, `[H, W]`.
        taken: where something that came to rest has become ground, `[H, W]`.
        still: frames for which a pixel has not changed, `[H, W]`.
        sprites: in the order of their labels.
        labels: how many labels were given.
    """

    frames: int
    before: Image
    ground: Image
    known: Mask
    taken: Mask
    still: npt.NDArray[np.int32]
    sprites: tuple[Sprite, ...]
    labels: int


class _View(NamedTuple):
    """A frame and what is new in it: whether the ground has one color, what differs from the ground for certain, what
    changed lately, and what may be an object."""

    image: Image
    one_color: bool
    certain: Mask
    recent: Mask
    foreground: Mask


class Layers:
    """Labels of moving objects, frame by frame.

    Args:
        params: constants.

    Example:
        >>> import numpy as np
        >>> frames = np.zeros((4, 32, 32, 3), np.uint8)
        >>> for t in range(4):
        ...     frames[t, 8:16, 4 + 2 * t : 12 + 2 * t] = 200, 40, 40
        >>> labels, state = Layers()(frames)
        >>> labels.max(), int((labels[-1] == 1).sum())
        (1, 64)
    """

    def __init__(self, params: LayerParams = LayerParams()) -> None:
        self.params = params

    def __repr__(self) -> str:
        return f"Layers({self.params})"

    def __call__(
        self, frames: npt.NDArray[np.uint8], state: LayersState | None = None
    ) -> tuple[Labels, LayersState | None]:
        """Labels `[T, H, W]` int32 of frames `[T, H, W, 3]` uint8: 0 for the ground, one number for each object.

        Raises:
            InputError: frames of another shape or type, or of another size than the state's.
        """
        frames = np.asarray(frames)
        if frames.ndim != 4 or frames.shape[-1] != 3 or frames.dtype != np.uint8 or min(frames.shape[1:3]) < 3:
            raise InputError(f"frames must be [T, H, W, 3] uint8 of at least 3 x 3, got {frames.shape} {frames.dtype}")
        if state is not None and state.known.shape != frames.shape[1:3]:
            raise InputError(f"frames of {frames.shape[1:3]} do not go on with a state of {state.known.shape}")
        labels = np.zeros(frames.shape[:3], np.int32)
        for t, frame in enumerate(frames):
            labels[t], state = self.step(frame.astype(np.int32), state)
        return labels, state

    def step(self, image: Image, state: LayersState | None) -> tuple[Labels, LayersState]:
        """The labels `[H, W]` of one image `[H, W, 3]`, and the next state."""
        state = _begin(image) if state is None else state
        view, state = self._compare(image, state)
        sprites = [self._align(sprite, view, state.known) for sprite in state.sprites]
        labels = self._assign(sprites, view, state.known)
        births = self._births(labels, view, state)
        sprites, state = self._update(sprites, labels, view, state)
        if not view.one_color:
            sprites = self._merge(sprites, labels)
        sprites, number = self._begin_sprites(births, labels, view, state, sprites)
        if not view.one_color:
            learned = (state.still >= self.params.static_frames) & (labels == 0)
            state.ground[learned] = image[learned]
            state = state._replace(known=state.known | learned)
        shown = [one.label for one in sprites if one.confirmed]
        now = state._replace(frames=state.frames + 1, before=image, sprites=tuple(sprites), labels=number)
        return np.where(np.isin(labels, shown), labels, 0).astype(np.int32), now

    def _compare(self, image: Image, state: LayersState) -> tuple[_View, LayersState]:
        """What differs from the ground and from the frame before."""
        p = self.params
        color = commonest_color(image, p.ground_ratio)
        known, ground = state.known, state.ground.copy()
        if color is not None:
            known = np.ones_like(known)
            ground[~state.taken] = color
        still = state.still
        if state.frames:
            still = np.where(np.abs(image - state.before).max(-1) <= p.same_color, still + 1, 0).astype(np.int32)
        certain = known & (np.abs(image - ground).max(-1) > p.same_color)
        # Of the second frame, only what has changed just now.
        recent = still < min(state.frames, p.static_frames)
        foreground = certain | ~known & recent
        if color is None and state.frames:
            foreground = ndimage.binary_closing(np.pad(foreground, 2))[2:-2, 2:-2]
            foreground = ndimage.binary_opening(ndimage.binary_fill_holes(foreground))
            foreground |= moved_parts(color_parts(image, p.same_color), recent, p.min_area_px, p.rim_ratio)
        view = _View(image, color is not None, certain, recent, foreground)
        return view, state._replace(ground=ground, known=known, still=still)

    def _align(self, sprite: Sprite, view: _View, known: Mask) -> Sprite:
        """A sprite with the displacement that fits best."""
        p = self.params
        reach = 2 if sprite.age else p.max_shift_px
        row, column = (round(v) for v in sprite.velocity)
        shifts = [(row + a, column + b) for a in range(-reach, reach + 1) for b in range(-reach, reach + 1)]
        away = [np.hypot(a - sprite.velocity[0], b - sprite.velocity[1]) for a, b in shifts]
        costs = self._costs(sprite, view.image, view.foreground | ~known, shifts) + 0.005 * np.array(away)
        best = int(costs.argmin())
        return sprite._replace(shift=shifts[best], misfit=float(costs[best]))

    def _costs(self, sprite: Sprite, image: Image, free: Mask, shifts: Sequence[Shift]) -> Floats:
        """Mean cost of each displacement, as a fraction of `max_misfit`; pixels of the ground or outside cost extra."""
        height, width = free.shape
        rows, columns = np.nonzero(sprite.mask)
        low, high = (bound[rows, columns] for bound in half_pixel_bounds(sprite.image))
        costs = np.ones(len(shifts))
        for i, (a, b) in enumerate(shifts):
            y, x = rows + a, columns + b
            inside = (y >= 0) & (y < height) & (x >= 0) & (x < width)
            if inside.any():
                y, x = y[inside], x[inside]
                cost = misfit(image[y, x], low[inside], high[inside], self.params.max_misfit) / self.params.max_misfit
                costs[i] = (cost.sum() + 0.5 * (~free[y, x]).sum() + 0.3 * (~inside).sum()) / len(rows)
        return costs

    def _assign(self, sprites: list[Sprite], view: _View, known: Mask) -> Labels:
        """The sprite that explains a pixel best; parts of one color go to one sprite as a whole."""
        p, image = self.params, view.image
        labels = np.zeros(known.shape, np.int32)
        if not sprites:
            return labels
        fits, distances = zip(*(self._fit(sprite, image) for sprite in sprites), strict=True)
        fit, distance = np.array(fits), np.array(distances)
        outside = 0.5 * fit if view.one_color else p.accept_ratio
        cost = np.where(distance == 0, fit, outside + p.margin_ratio * distance)
        best = cost.argmin(0)
        numbers = np.array([sprite.label for sprite in sprites])
        possible = view.foreground
        if not view.one_color:
            moving = np.array([sprite.path >= 1 or any(sprite.shift) for sprite in sprites])
            covered = distance.min(0) == 0
            possible = covered & (possible | moving[best]) | possible & (view.certain | view.recent)
        labels = np.where(possible & (cost.min(0) < p.accept_ratio), numbers[best], 0).astype(np.int32)
        parts = color_parts(image, p.same_color, possible)
        area = np.bincount(parts.ravel())
        for part in np.nonzero(area[1:] >= p.min_area_px)[0] + 1:
            pixels = parts == part
            if np.ptp(image[pixels], axis=0).max() > 3 * p.same_color:
                continue
            apart = distance[:, pixels]
            costs = fit[:, pixels].mean(1) + 0.25 * np.maximum(apart.min(1) - 1, 0) + 0.02 * apart.mean(1)
            labels[pixels] = numbers[costs.argmin()] if costs.min() < 0.25 else 0
        return labels

    def _fit(self, sprite: Sprite, image: Image) -> tuple[Floats, Floats]:
        """Cost of every pixel against the nearest pixel of a sprite, and the distance to that."""
        mask = shifted(sprite.mask, sprite.shift)
        if not mask.any():
            return np.full(mask.shape, 9.0), np.full(mask.shape, 99.0)
        distance, nearest = ndimage.distance_transform_edt(~mask, return_indices=True)
        low, high = (shifted(bound, sprite.shift)[tuple(nearest)] for bound in half_pixel_bounds(sprite.image))
        return misfit(image, low, high, self.params.max_misfit) / self.params.max_misfit, distance

    def _births(self, labels: Labels, view: _View, state: LayersState) -> list[tuple[Mask, Shift | None]]:
        """Parts of the foreground that no sprite explains, with the displacement where it is known.

        Small ones are given to the sprite beside them.
        """
        p = self.params
        rest = view.foreground & (labels == 0)
        if state.frames == 1 and not view.one_color:
            return self.coherent_parts(view.image, state.before, view.foreground)
        if not view.one_color:
            rest &= view.certain
        births: list[tuple[Mask, Shift | None]] = []
        components, count = ndimage.label(rest)
        parts = color_parts(view.image, p.same_color, rest)
        for component in range(1, count + 1):
            whole = components == component
            groups = self._color_groups(view.image, whole, parts)
            for group in groups or [whole]:
                ring = labels[ndimage.binary_dilation(group) & ~group]
                beside = ring[ring > 0]
                if len(beside):
                    label = np.bincount(beside).argmax()
                    share = (beside == label).sum() / len(ring)
                    if group.sum() < p.min_area_px or (not groups and share > 0.25):
                        labels[group] = label
                        continue
                if group.sum() >= p.min_area_px:
                    births.append((group, None))
        return births

    def _color_groups(self, image: Image, whole: Mask, parts: Labels) -> list[Mask]:
        """Parts of one color of a component, small ones given to the nearest large one; none if it is textured."""
        p = self.params
        numbers, areas = np.unique(parts[whole], return_counts=True)
        large = numbers[areas >= p.min_area_px]
        if areas[areas >= p.min_area_px].sum() < 0.7 * whole.sum():
            return []
        if any(np.ptp(image[parts == one], axis=0).max() > 3 * p.same_color for one in large):
            return []
        nearest = ndimage.distance_transform_edt(~np.isin(parts, large), return_distances=False, return_indices=True)
        filled = parts[tuple(nearest)]
        return [whole & (filled == one) for one in large]

    def coherent_parts(self, image: Image, before: Image, foreground: Mask) -> list[tuple[Mask, Shift | None]]:
        """Parts of the foreground that moved by one displacement each since the frame before.

        What matches nothing there has just been uncovered, and is left out.
        """
        p = self.params
        reach = range(-p.max_shift_px, p.max_shift_px + 1)
        shifts = [(a, b) for a in reach for b in reach]
        low, high = half_pixel_bounds(before)
        weight = foreground.astype(np.float64)
        count = np.maximum(cv2.blur(weight, (5, 5)), 1e-6)
        costs = np.empty((len(shifts), *foreground.shape))
        for i, shift in enumerate(shifts):
            apart = misfit(image, shifted(low, shift, -99), shifted(high, shift, -99), p.max_misfit)
            costs[i] = cv2.blur(apart / p.max_misfit * weight, (5, 5)) / count
        explained = costs < 0.25
        good = explained & (costs < costs.min(0) + 0.08)
        found: list[tuple[Mask, Shift | None]] = []
        components, number = ndimage.label(foreground)
        for component in range(1, number + 1):
            whole = components == component
            left, chosen = whole.copy(), list[int]()
            while left.sum() >= p.min_area_px and len(chosen) < 4:
                support = (good & left).sum((1, 2))
                best = int(support.argmax())
                if support[best] < p.min_area_px:
                    break
                a, b = shifts[best]
                if all(np.hypot(a - shifts[i][0], b - shifts[i][1]) >= 1.5 for i in chosen):
                    chosen.append(best)
                left &= ~explained[best]
            chosen = [i for i in chosen if any(shifts[i])]
            if chosen:
                nearest = costs[chosen].argmin(0)
                matched = whole & (costs[chosen].min(0) < 0.4)
                for j, i in enumerate(chosen):
                    pieces, n = ndimage.label(ndimage.binary_opening(matched & (nearest == j)))
                    areas = np.bincount(pieces.ravel())
                    found += [
                        (ndimage.binary_fill_holes(pieces == k), shifts[i])
                        for k in range(1, n + 1)
                        if areas[k] >= p.min_area_px
                    ]
        return found

    def _update(
        self, sprites: list[Sprite], labels: Labels, view: _View, state: LayersState
    ) -> tuple[list[Sprite], LayersState]:
        """Sprites where they are now, with what is seen of them; what has come to rest becomes ground."""
        p, kept, taken = self.params, list[Sprite](), state.taken.copy()
        for sprite in sprites:
            seen = labels == sprite.label
            if not view.one_color and seen.any():
                closed = ndimage.binary_closing(np.pad(seen, 2))[2:-2, 2:-2]
                seen |= ndimage.binary_fill_holes(closed) & (labels == 0)
                labels[seen] = sprite.label
            mask, image = shifted(sprite.mask, sprite.shift), shifted(sprite.image, sprite.shift)
            if seen.sum() < 3:
                if sprite.lost < p.max_lost_frames:
                    kept.append(sprite._replace(mask=mask, image=image, lost=sprite.lost + 1))
                continue
            rim = ndimage.binary_dilation(seen) & ~ndimage.binary_erosion(seen, border_value=1)
            resting = state.still > p.static_frames
            rests = not any(sprite.shift) and resting[seen].mean() > 0.8
            if rests and (not view.one_color or resting[rim].mean() > 0.98):
                taken |= seen
                state.ground[seen] = view.image[seen]
                labels[seen] = 0
                continue
            hidden = mask & (labels != sprite.label) & (labels > 0)
            image[seen] = view.image[seen]
            rate = 0.5 if sprite.age else 1.0
            (v, u), (a, b) = sprite.velocity, sprite.shift
            path = sprite.path + float(np.hypot(a, b))
            moved = sprite._replace(
                mask=seen | hidden,
                image=image,
                velocity=(v + rate * (a - v), u + rate * (b - u)),
                age=sprite.age + 1,
                lost=0,
                path=path,
            )
            sure = path >= p.confirm_path_px and sprite.misfit < p.confirm_misfit_ratio
            kept.append(moved._replace(confirmed=sprite.confirmed or sure))
        return kept, state._replace(taken=taken)

    def _merge(self, sprites: list[Sprite], labels: Labels) -> list[Sprite]:
        """One sprite of those that touch and move alike; the larger one keeps its label."""
        sprites = list(sprites)
        while pair := self._alike(sprites, labels):
            large, small = pair
            image = large.image.copy()
            image[labels == small.label] = small.image[labels == small.label]
            labels[labels == small.label] = large.label
            joined = large._replace(
                mask=large.mask | small.mask, image=image, confirmed=large.confirmed or small.confirmed
            )
            sprites = [joined if one is large else one for one in sprites if one is not small]
        return sprites

    def _alike(self, sprites: list[Sprite], labels: Labels) -> tuple[Sprite, Sprite] | None:
        """The first two of them that are one object, the larger one first."""
        areas = {one.label: int((labels == one.label).sum()) for one in sprites}
        for large in sprites:
            for small in sprites:
                if large is small or not areas[small.label] or areas[large.label] < areas[small.label]:
                    continue
                if min(large.path, small.path) < 1:
                    continue
                apart = np.hypot(*np.subtract(large.velocity, small.velocity))
                border = ndimage.binary_dilation(labels == small.label) & (labels == large.label)
                if apart < self.params.same_velocity_px and border.sum() >= 0.5 * np.sqrt(areas[small.label]):
                    return large, small
        return None

    def _begin_sprites(
        self,
        births: list[tuple[Mask, Shift | None]],
        labels: Labels,
        view: _View,
        state: LayersState,
        sprites: list[Sprite],
    ) -> tuple[list[Sprite], int]:
        """All sprites with the new ones, and how many labels were given."""
        number, certain = state.labels, view.one_color or state.frames == 1
        for mask, shift in births:
            mask = mask & (labels == 0)
            if mask.sum() < 0.7 * self.params.min_area_px:
                continue
            number += 1
            labels[mask] = number
            new = Sprite(number, mask, view.image.copy(), confirmed=certain)
            if shift is not None:
                new = new._replace(velocity=(float(shift[0]), float(shift[1])), age=1, path=1.0)
            sprites = [*sprites, new]
        return sprites, number


def _begin(image: Image) -> LayersState:
    size = image.shape[:2]
    nowhere = np.zeros(size, bool)
    return LayersState(0, image, np.zeros_like(image), nowhere, nowhere, np.zeros(size, np.int32), (), 0)
