"""A world of textured walls seen by row cameras, by ray casting: truth that knows nothing of the library."""

import numpy as np


class PlanarWorld:
    """Vertical walls with panels of random width and brightness, in the plane of the cameras.

    Args:
        walls: `[S, 2, 2]` end points, m.
        panels: smallest and largest width of a panel, m.
    """

    def __init__(self, walls, panels=(0.1, 0.6), seed=0):
        rng = np.random.default_rng(seed)
        self.start = np.asarray(walls, float)[:, 0]
        self.along = np.asarray(walls, float)[:, 1] - self.start
        self.length = np.linalg.norm(self.along, axis=1)
        self.along = self.along / self.length[:, None]
        self.edges, self.light = [], []
        for length in self.length:
            edges = np.cumsum(rng.uniform(*panels, size=int(length / panels[0]) + 2))
            self.edges.append(edges)
            self.light.append(rng.uniform(0.05, 0.95, size=len(edges) + 1))

    def cast(self, eye, angles):
        """Distance to the nearest wall and its brightness for rays from `eye` at world angles."""
        ray = np.stack([np.cos(angles), np.sin(angles)], -1)
        best, seen = np.full(angles.shape, np.inf), np.zeros(angles.shape)
        for k in range(len(self.length)):
            to = self.start[k] - eye
            cross = ray[..., 0] * self.along[k, 1] - ray[..., 1] * self.along[k, 0]
            with np.errstate(divide="ignore", invalid="ignore"):
                distance = (to[0] * self.along[k, 1] - to[1] * self.along[k, 0]) / cross
                place = (to[0] * ray[..., 1] - to[1] * ray[..., 0]) / cross
            hit = (distance > 1e-9) & (place >= 0) & (place <= self.length[k]) & (distance < best)
            panel = np.searchsorted(self.edges[k], np.where(hit, place, 0.0))
            best = np.where(hit, distance, best)
            seen = np.where(hit, self.light[k][panel], seen)
        return best, seen

    def row(self, eye, heading, width=640, focal=430.0, fine=8):
        """Brightness of one row camera's pixels, each the mean of `fine` rays spread over it, `[width]`."""
        column = (np.arange(width * fine) + 0.5) / fine - 0.5
        angles = heading + np.arctan(((width - 1) / 2 - column) / focal)
        return self.cast(np.asarray(eye), angles)[1].reshape(width, fine).mean(1)

    def drive(self, poses, baseline=0.3, **camera):
        """Left and right rows `[T, 640]` seen from poses (x, y, heading), and the left eyes `[T, 2]`."""
        lefts, rights, eyes = [], [], []
        for x, y, heading in poses:
            side = np.array([-np.sin(heading), np.cos(heading)]) * baseline / 2
            middle = np.array([x, y])
            lefts.append(self.row(middle + side, heading, **camera))
            rights.append(self.row(middle - side, heading, **camera))
            eyes.append(middle + side)
        return np.stack(lefts), np.stack(rights), np.stack(eyes)


def hallway(half_width=1.0, length=14.0, seed=0, **options):
    """A straight hallway along x with an end wall."""
    walls = [
        [(-1.0, half_width), (length, half_width)],
        [(-1.0, -half_width), (length, -half_width)],
        [(length, -half_width), (length, half_width)],
    ]
    return PlanarWorld(walls, seed=seed, **options)


def to_body(pose, x, y):
    """Points of the world in the body frame; pose and points broadcast."""
    cos, sin = pose.heading.cos(), pose.heading.sin()
    ahead, aside = x - pose.x, y - pose.y
    return cos * ahead + sin * aside, cos * aside - sin * ahead
