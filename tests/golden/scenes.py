"""What the reference numbers were made of: scenes that need nothing of the library that could change."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from tests.navigation.planar_world import PlanarWorld, hallway
from tests.vision.camera.passing_scenes import SIZE, ground

DT = 1 / 30


def crossing(frames: int = 100) -> Tensor:
    """Red goes right along the top, green then left along the bottom: `[T, 3, 112, 200]` uint8, 25 frames a second."""
    video = ground().repeat(frames, 1, 1, 1)
    for n in range(8, frames):
        for first, step, top, color in ((8, 4, 12, (0.8, 0.2, 0.2)), (40, -4, 74, (0.2, 0.8, 0.2))):
            left = step * (n - first) + (0 if step > 0 else SIZE[1] - 24)
            if n >= first and 0 <= left <= SIZE[1] - 24:
                video[n, :, top : top + 24, left : left + 24] = torch.tensor(color)[:, None, None]
    return (video * 255).round().to(torch.uint8)


def seen(world: PlanarWorld, x: float, y: float, heading: float) -> np.ndarray:
    """Walls that go up without end on a floor of blotches, as one camera 0.2 m high sees them, `[480, 640]` uint8."""
    angles = heading + np.arctan((319.5 - np.arange(640)) / 430)
    distance, light = world.cast(np.array([x, y]), angles)
    picture = np.broadcast_to(light, (480, 640)).copy()
    ahead = 0.2 * 430 / (np.arange(240, 480) - 239.5)[:, None]
    away = ahead / np.cos(angles - heading)
    column, row = x + away * np.cos(angles), y + away * np.sin(angles)
    floor = 0.5 + 0.1 * np.sin(9 * column) * np.cos(11 * row) + 0.05 * np.sin(37 * column + 23 * row)
    picture[240:] = np.where(away < distance, floor, picture[240:])
    return np.round(picture * 255).astype(np.uint8)


def towards_a_wall(steps: int = 90) -> tuple[Tensor, Tensor]:
    """What two cameras see on the way to the end of a hallway, at 0.5 m/s and a little aslant, `[T, 1, 480, 640]`."""
    world, pictures = hallway(1.2, length=3.0, seed=0), []
    for n in range(steps):
        x, y, heading = 0.5 * DT * n, 0.1 * DT * n, 0.1
        side = 0.15 * np.array([-np.sin(heading), np.cos(heading)])
        pictures.append([seen(world, x + s * side[0], y + s * side[1], heading) for s in (1, -1)])
    left, right = torch.from_numpy(np.array(pictures))[:, :, None].unbind(1)
    return left, right
