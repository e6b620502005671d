"""Quads with pictures on them, for the model of a building."""

from __future__ import annotations

from typing import Any

import numpy as np

from ndtorch_robot.sim.paint import Painted, Patch
from ndtorch_robot.sim.plan import Floats


class Mesh:
    """Quads with texture coordinates."""

    def __init__(self) -> None:
        self.points: list[tuple[float, float, float]] = []
        self.coordinates: list[tuple[float, float]] = []
        self.faces: list[tuple[int, int, int]] = []

    def quad(self, points: list[tuple[float, float, float]], coordinates: list[tuple[float, float]]) -> None:
        """Add a quad, its corners counter-clockwise as seen from where it shall be visible."""
        n = len(self.points)
        self.points += points
        self.coordinates += coordinates
        self.faces += [(n, n + 1, n + 2), (n, n + 2, n + 3)]

    def wall(self, segment: Floats, surface: Painted, patches: list[Patch]) -> None:
        """A vertical wall along a segment, visible from its left."""
        columns = surface.texels.shape[1]
        (ax, ay), (bx, by) = segment
        for n, patch in enumerate(patches):
            low, high = round(columns * n / len(patches)) / columns, round(columns * (n + 1) / len(patches)) / columns
            x0, y0, x1, y1 = ax + low * (bx - ax), ay + low * (by - ay), ax + high * (bx - ax), ay + high * (by - ay)
            top, low_z = surface.height, surface.bottom
            self.quad(
                [(x1, y1, low_z), (x0, y0, low_z), (x0, y0, top), (x1, y1, top)],
                [
                    (patch.end, patch.bottom),
                    (patch.start, patch.bottom),
                    (patch.start, patch.top),
                    (patch.end, patch.top),
                ],
            )

    def level(self, bounds: tuple[float, ...], z: float, texture: tuple[float, ...], facing_down: bool = False) -> None:
        """A horizontal rectangle."""
        left, right, bottom, top = bounds
        a, b, c, d = texture
        points = [(left, bottom, z), (right, bottom, z), (right, top, z), (left, top, z)]
        coordinates = [(a, c), (b, c), (b, d), (a, d)]
        if facing_down:
            points.reverse()
            coordinates.reverse()
        self.quad(points, coordinates)

    def add(self, spec: Any, name: str) -> None:
        """Put the mesh into a model as one geom with the texture of the same name."""
        import mujoco

        mesh = spec.add_mesh(name=name)
        mesh.uservert = np.array(self.points, np.float32).ravel()
        mesh.userface = np.array(self.faces, np.int32).ravel()
        # Texture rows are stored from the top.
        mesh.usertexcoord = (np.array(self.coordinates, np.float32) * [1, -1] + [0, 1]).astype(np.float32).ravel()
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        spec.worldbody.add_geom(
            name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, material=name, contype=0, conaffinity=0
        )
