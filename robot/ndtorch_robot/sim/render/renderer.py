"""What a renderer of a simulated world is given and does."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

from ndtorch.navigation import Rect
from ndtorch_robot.sim.procedural_textures import Image

if TYPE_CHECKING:
    import mujoco

Vector = tuple[float, float, float]

NEAR, FAR = 0.02, 60.0
"""Nearest and farthest distance that is rendered, m."""


class View(NamedTuple):
    """Pose of a camera: its position, m, its optical axis and its upward axis, two unit vectors at a right angle."""

    position: Vector
    forward: Vector
    up: Vector


class Lens(NamedTuple):
    """Focal length and center of a camera in pixels, and the size of its frames."""

    focal: float
    center: tuple[float, float]
    width: int
    height: int

    @property
    def frame(self) -> Rect:
        """The whole frame."""
        return Rect(0, self.height, 0, self.width)


Shot = Sequence[tuple[View, Rect]]
"""A strip: its parts from the top down, each with the view from which it is rendered."""


class Renderer(Protocol):
    """Renders a world."""

    def update(self, data: mujoco.MjData) -> None:
        """Take the poses of all bodies from here on."""

    def strips(self, shots: Sequence[Shot]) -> list[Image]:
        """The pixels of strips, each `[3, h, w]`."""

    def frame(self, view: View) -> Image:
        """A whole frame `[3, H, W]`."""

    def close(self) -> None:
        """Free what it holds."""
