"""What draws the pictures of a simulated camera, whichever way."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

from ndtorch.navigation import Rect
from ndtorch_robot.sim.paint import Image

if TYPE_CHECKING:
    import mujoco

Three = tuple[float, float, float]

NEAR, FAR = 0.02, 60.0
"""Nearest and farthest that is drawn, m."""


class View(NamedTuple):
    """Where a camera is, m, where it looks and which way it holds for up, two directions at a right angle."""

    place: Three
    forward: Three
    up: Three


class Lens(NamedTuple):
    """Focal length and center of a camera in pixels, and the size of its frames."""

    focal: float
    center: tuple[float, float]
    width: int
    height: int

    @property
    def frame(self) -> Rect:
        """The whole picture."""
        return Rect(0, self.height, 0, self.width)


Shot = Sequence[tuple[View, Rect]]
"""A strip: its parts from the top down, each with the view it is drawn from."""


class Painter(Protocol):
    """Draws a world."""

    def take(self, data: mujoco.MjData) -> None:
        """Things stand as they do here from now on."""

    def strips(self, shots: Sequence[Shot]) -> list[Image]:
        """The pixels of strips, each `[3, h, w]`. There are always as many, each as large as before."""

    def frame(self, view: View) -> Image:
        """A whole picture `[3, H, W]`."""

    def close(self) -> None:
        """Give back what it holds."""
