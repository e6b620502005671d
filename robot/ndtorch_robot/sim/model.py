"""The MuJoCo model of a building: painted walls to see, boxes to bump into, and the car."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ndtorch.navigation import Body, StereoRig
from ndtorch_robot.sim.plan import Floats, Plan, cylinder
from ndtorch_robot.sim.procedural_textures import (
    AtlasRect,
    Image,
    Surface,
    Walls,
    ceiling_texture,
    floor_texture,
    pack,
    profile,
    ring_textures,
    to_bytes,
)

if TYPE_CHECKING:
    import mujoco

THICKNESS = 0.04
"""Half the depth of the collision box behind the face of a wall, m: many times the distance driven in a step."""

SKIRTING = (0.006, 0.08)
"""Depth and height of the skirting, m."""

PEDESTRIAN_SIZE = (0.18, 0.25, 0.9)
"""Half the sides of the pedestrian, m."""

MOVING_RADIUS, MOVING_HEIGHT = 0.15, 1.0
"""Of a moving cylinder, m."""

GROUND_CLEARANCE = 0.05
"""Height of the underside of the car of [A] above the floor, m; its top is a centimetre below its cameras."""

Pair = tuple[float, float]


class World(NamedTuple):
    """What `build` makes: the compiled model and, for the scorer, the profile of every wall.

    Attributes:
        model: MuJoCo model; joints x, y, yaw of the car are `qpos[0:3]`, mocap bodies are the pedestrian,
            where there is one, and then the moving cylinders.
        profiles: for each edge of each ring, its brightness `[columns]` at the height of the cameras.
    """

    model: mujoco.MjModel
    profiles: list[Floats]


class Mesh:
    """Quads with texture coordinates, for the model of a building."""

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

    def upright(self, start: Pair, end: Pair, z: Pair, u: Pair = (0.0, 0.0), v: Pair = (0.0, 0.0)) -> None:
        """A vertical rectangle from `start` to `end`, visible from its left; `u`, `v` are as `z` from low to high."""
        self.quad(
            [(*end, z[0]), (*start, z[0]), (*start, z[1]), (*end, z[1])],
            [(u[1], v[0]), (u[0], v[0]), (u[0], v[1]), (u[1], v[1])],
        )

    def wall(self, segment: Floats, surface: Surface, patches: list[AtlasRect]) -> None:
        """A vertical wall along a segment, visible from its left."""
        columns, (a, b) = surface.texels.shape[1], segment
        for n, p in enumerate(patches):
            low, high = (round(columns * k / len(patches)) / columns for k in (n, n + 1))
            start, end = a + low * (b - a), a + high * (b - a)
            z = (surface.bottom, surface.height)
            self.upright((start[0], start[1]), (end[0], end[1]), z, (p.start, p.end), (p.bottom, p.top))

    def level(self, bounds: tuple[float, ...], z: float, size: Pair, facing_down: bool = False) -> None:
        """A horizontal rectangle with so many repetitions of its texture."""
        (left, right, bottom, top), (u, v) = bounds, size
        corners = [(left, bottom, 0.0, 0.0), (right, bottom, u, 0.0), (right, top, u, v), (left, top, 0.0, v)]
        corners = corners[::-1] if facing_down else corners
        self.quad([(x, y, z) for x, y, _, _ in corners], [(a, b) for _, _, a, b in corners])

    def add(self, spec: Any, body: Any, name: str, rgba: list[float] | None = None) -> None:
        """Add the mesh to a body as a geom with the material of the same name, or in one color."""
        import mujoco

        mesh = spec.add_mesh(name=name)
        mesh.uservert = np.array(self.points, np.float32).ravel()
        mesh.userface = np.array(self.faces, np.int32).ravel()
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        look: dict[str, Any] = {"rgba": rgba}
        if rgba is None:
            # Texture rows are stored from the top.
            mesh.usertexcoord = (np.array(self.coordinates, np.float32) * [1, -1] + [0, 1]).astype(np.float32).ravel()
            look = {"material": name}
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, contype=0, conaffinity=0, **look)


def build(
    plan: Plan,
    seed: int = 0,
    walls: Walls = "textured",
    pedestrian: bool = False,
    rig: StereoRig | None = None,
    body: Body | None = None,
    cylinders: int = 0,
    plain_cylinders: bool = False,
) -> World:
    """Paint and build a plan. The seed decides what it looks like.

    Args:
        cylinders: this many move, with the texture of pillars, or in plain coarse checks.
    """
    import mujoco

    rng = np.random.default_rng((seed, 100))
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    rig, body = rig or StereoRig(), body or Body()
    spec.visual.global_.offwidth, spec.visual.global_.offheight = max(640, rig.width), max(480, rig.height)
    spec.visual.quality.offsamples = 0  # the pixels of a strip must not depend on neighbours outside it
    light = spec.visual.headlight
    light.ambient, light.diffuse, light.specular = [1.0] * 3, [0.0] * 3, [0.0] * 3
    spec.stat.extent, spec.stat.center = 1.0, [0.0, 0.0, 0.0]

    surfaces = [s for r in plan.rings for s in ring_textures(r, plan.height, rng, walls)]
    atlas, patches = pack(surfaces)
    floor, ground = floor_texture(plan, rng)
    images = {"walls": atlas, "floor": floor, "ceiling": ceiling_texture()}
    wall_mesh, floor_mesh, ceiling_mesh = Mesh(), Mesh(), Mesh()
    for segment, surface, cut in zip(plan.segments, surfaces, patches, strict=True):
        wall_mesh.wall(segment, surface, cut)
    if walls == "textured":
        add_skirting(spec, plan, closed=rig.camera_height < SKIRTING[1])
    left, right, bottom, top = ground
    floor_mesh.level(ground, 0.0, (1.0, 1.0))
    ceiling_mesh.level(ground, plan.height, ((right - left) / 9.6, (top - bottom) / 9.6), facing_down=True)
    for solid in plan.solids:
        if solid.height is not None and solid.height < plan.height and not solid.radius:
            add_lid(spec, solid.array, solid.height, solid.bottom)
    add_textures(spec, images)
    for name, mesh in (("walls", wall_mesh), ("floor", floor_mesh), ("ceiling", ceiling_mesh)):
        mesh.add(spec, spec.worldbody, name)
    add_collisions(spec, plan)
    add_car(spec, body, rig.camera_height)
    if pedestrian:
        x, y, z = PEDESTRIAN_SIZE
        corners = [(-x, -y), (x, -y), (x, y), (-x, y)]
        box = (mujoco.mjtGeom.mjGEOM_BOX, list(PEDESTRIAN_SIZE))
        images["pedestrian"] = checks(4, rng)
        add_moving(spec, images, "pedestrian", corners, 2 * z, box)
    for k in range(cylinders):
        solid = cylinder(0.0, 0.0, MOVING_RADIUS, MOVING_HEIGHT)
        round_ = (mujoco.mjtGeom.mjGEOM_CYLINDER, [MOVING_RADIUS, MOVING_HEIGHT / 2, 0])
        corners = [(float(a), float(b)) for a, b in solid.array[::-1]]
        if plain_cylinders:
            images[f"moving-{k}"] = checks(len(corners), rng)
        else:
            sides = ring_textures(solid, plan.height, rng, walls)
            images[f"moving-{k}"] = np.concatenate([side.texels for side in sides], 1)
        add_moving(spec, images, f"moving-{k}", corners, MOVING_HEIGHT, round_)
    model = spec.compile()
    for name, image in images.items():
        fill_texture(model, name, image)
    return World(model, [profile(s, rig.camera_height) for s in surfaces])


def add_textures(spec: Any, images: dict[str, Image]) -> None:
    """A material with an empty texture of the right size for each image; `fill_texture` fills it."""
    import mujoco

    for name, image in images.items():
        flat = {"type": mujoco.mjtTexture.mjTEXTURE_2D, "builtin": mujoco.mjtBuiltin.mjBUILTIN_FLAT, "nchannel": 3}
        spec.add_texture(name=name, width=image.shape[1], height=image.shape[0], **flat)
        material = spec.add_material(name=name, rgba=[1, 1, 1, 1], specular=0, shininess=0)
        textures = [""] * int(mujoco.mjtTextureRole.mjNTEXROLE)
        textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = name
        material.textures = textures


def fill_texture(model: mujoco.MjModel, name: str, image: Image) -> None:
    """Put an image into a texture of a compiled model: far faster than through the specification."""
    begin = int(model.tex_adr[model.texture(name).id])
    model.tex_data[begin : begin + image.size] = image.ravel()


def add_skirting(spec: Any, plan: Plan, closed: bool = False) -> None:
    """A dark board along the foot of the walls, as a mesh: in the texture, the filter would blur it away.

    Args:
        closed: boards meet at corners, for cameras that see them from their own height: slits between them would be
            features in the rows that are ranged.
    """
    kinds = [kind for shape in plan.rings for kind in shape.kinds]
    boards = Mesh()
    for ((ax, ay), (bx, by)), kind in zip(plan.segments, kinds, strict=True):
        if kind == "wall":
            length = math.hypot(bx - ax, by - ay)
            x, y = -(by - ay) / length * SKIRTING[0], (bx - ax) / length * SKIRTING[0]
            u, v = (y, -x) if closed else (0.0, 0.0)
            boards.upright((ax + x - u, ay + y - v), (bx + x + u, by + y + v), (0.0, SKIRTING[1]))
    if boards.points:
        boards.add(spec, spec.worldbody, "skirting", [0.2, 0.19, 0.18, 1])


def add_lid(spec: Any, corners: Floats, height: float, bottom: float = 0.0) -> None:
    """The top of a piece of furniture, and its underside where there is air below: to look at only.

    It is the bounding box of the piece, less a millimetre.
    """
    import mujoco

    low, high = corners.min(0), corners.max(0)
    middle, half = (low + high) / 2, (high - low) / 2
    deep = (height - bottom - 0.002) / 2 if bottom else min(0.01, (height - 0.002) / 2)
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=[middle[0], middle[1], height - deep - 0.001],
        size=[half[0] - 0.001 * bool(bottom), half[1] - 0.001 * bool(bottom), deep],
        rgba=[0.45, 0.33, 0.22, 1],
        contype=0,
        conaffinity=0,
    )


def add_collisions(spec: Any, plan: Plan) -> None:
    """An invisible box behind the face of every wall, and a cylinder for what is round."""
    import mujoco

    for shape in plan.rings:
        if not shape.stops:
            continue
        low, high = shape.bottom, min(shape.height or plan.height, plan.height)
        if shape.radius:
            x, y = shape.array.mean(0)
            size = [shape.radius, high / 2, 0]
            add_collision(spec.worldbody, mujoco.mjtGeom.mjGEOM_CYLINDER, [x, y, high / 2], size)
            continue
        for (ax, ay), (bx, by) in shape.sides:
            length = math.hypot(bx - ax, by - ay)
            nx, ny = -(by - ay) / length, (bx - ax) / length
            angle = math.atan2(by - ay, bx - ax)
            # Thin solids are thinner than two such boxes, which may overlap or stick out by a little.
            add_collision(
                spec.worldbody,
                mujoco.mjtGeom.mjGEOM_BOX,
                [(ax + bx) / 2 - nx * THICKNESS, (ay + by) / 2 - ny * THICKNESS, (low + high) / 2],
                [length / 2, THICKNESS, (high - low) / 2],
                quat=[math.cos(angle / 2), 0, 0, math.sin(angle / 2)],
            )


def add_collision(body: Any, kind: Any, pos: list[float], size: list[float], **more: Any) -> None:
    """An invisible geom that only the car collides with."""
    body.add_geom(type=kind, pos=pos, size=size, contype=1, conaffinity=0, group=3, **more)


def add_car(spec: Any, body: Body, camera_height: float) -> None:
    """The body of the robot; its middle is the point it turns about."""
    import mujoco

    bottom = GROUND_CLEARANCE * min(1.0, body.unit_m)
    high = max(0.19 * body.unit_m, camera_height - 0.01) - bottom

    car = spec.worldbody.add_body(name="car")
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    for name, kind, axis in (("x", slide, [1, 0, 0]), ("y", slide, [0, 1, 0]), ("yaw", hinge, [0, 0, 1])):
        car.add_joint(name=name, type=kind, axis=axis)
    look = {"type": mujoco.mjtGeom.mjGEOM_BOX, "pos": [0, 0, bottom + high / 2]}
    look["size"] = [body.length_m / 2, body.width_m / 2, high / 2]
    car.add_geom(name="car", mass=8.0, contype=0, conaffinity=1, group=3, **look)


def checks(sides: int, rng: np.random.Generator) -> Image:
    """Coarse checks, six rows of one on each side."""
    return to_bytes(rng.uniform(0.1, 0.9, (6, sides, 3)).repeat(32, 0).repeat(32, 1))


def add_moving(
    spec: Any,
    images: dict[str, Image],
    name: str,
    corners: list[Pair],
    height: float,
    collision: tuple[Any, list[float]],
) -> None:
    """A body that can be moved, seen and bumped into, with the image of its name around its sides of equal width."""
    sides = len(corners)
    add_textures(spec, {name: images[name]})
    body, mesh = spec.worldbody.add_body(name=name, mocap=True), Mesh()
    for k, corner in enumerate(corners):
        mesh.upright(corners[(k + 1) % sides], corner, (0.0, height), ((k + 1) / sides, k / sides), (1.0, 0.0))
    mesh.add(spec, body, name)
    add_collision(body, collision[0], [0, 0, height / 2], collision[1])
