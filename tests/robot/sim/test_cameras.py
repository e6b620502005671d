"""What the simulated cameras see: geometry, strips against whole frames, textures."""

import math

import numpy as np
import pytest
import torch

from ndtorch.navigation import StereoRig
from ndtorch_robot.ports import DriveCommand
from ndtorch_robot.safety import SafeDrive
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.disturbances import read_disturbances
from ndtorch_robot.sim.plan import Plan, ring
from ndtorch_robot.sim.procedural_textures import Surface, floor_texture, pack
from ndtorch_robot.sim.simulation import RIG, Simulation


def test_edges_are_where_the_rig_says():
    """A dark pillar before blank walls: both its sides in the horizon rows of both cameras."""
    square = ring([(0, -3), (6, -3), (6, 3), (0, 3)], "blank")
    pillar = ring([(2.5, -0.2), (2.9, -0.2), (2.9, 0.2), (2.5, 0.2)], "door", solid=True)
    simulation = Simulation(Plan("test", square, (pillar,), (1.0, 0.0, 0.0)), walls="blank")
    left, right = simulation.cameras.look(simulation.data, 1.0, 0.0, 0.0)
    simulation.close()
    for eye, side in ((left, 0.15), (right, -0.15)):
        row = eye.row[0, :, 0].float().mean(0)
        jumps = torch.nonzero((row[1:] - row[:-1]).abs() > 30).flatten() + 0.5
        depth = 2.5 - 1.0 - RIG.forward
        wanted = [float(RIG.project(torch.tensor(depth), torch.tensor(y - side), 0.0)[0]) for y in (0.2, -0.2)]
        assert jumps.tolist() == pytest.approx(wanted, abs=1.0)
    # The subfields see floor only.
    assert left.field.shape == (1, 3, 29, 85)
    assert 0.03 < float(left.field.float().std()) / 255 * 2 < 0.2


def test_cameras_that_are_mounted_pitched_see_what_those_see_that_have_slipped():
    seen = []
    for pitch, slipped in ((math.radians(5), ""), (0.0, "pitch_deg=5")):
        rig, whole = StereoRig(pitch=pitch, forward=0.15), read_disturbances(slipped)
        simulation = Simulation(load_arena("room"), 3, rig=rig, disturbances=whole, full_frames=True)
        seen.append(simulation.read().left)
        simulation.close()
    assert torch.equal(*seen)


def test_nothing_is_painted_twice():
    """Where a square metre of carpet looks like another one, it is the same one."""
    floor, bounds = floor_texture(load_arena("room"), np.random.default_rng(0))
    assert floor.shape[0] == pytest.approx((bounds[3] - bounds[2]) * 128)
    grey = floor.mean(-1) - floor.mean()
    spectrum = np.abs(np.fft.fft2(grey)) ** 2
    correlation = np.fft.ifft2(spectrum).real
    correlation /= correlation[0, 0]
    correlation[:128, :128] = correlation[:128, -128:] = correlation[-128:, :128] = correlation[-128:, -128:] = 0
    assert correlation.max() < 0.3
    assert 0.02 < grey.std() / 255 < 0.05


def test_packing_cuts_long_surfaces():
    rng = np.random.default_rng(0)
    surfaces = [Surface(rng.integers(0, 255, (9, n, 3), dtype=np.uint8), 2.0) for n in (300, 50, 120)]
    atlas, patches = pack(surfaces, width=128, margin=2)
    assert [len(p) for p in patches] == [3, 1, 1]
    for surface, cut in zip(surfaces, patches, strict=True):
        parts = []
        for p in cut:
            u = [round(v * atlas.shape[1]) for v in (p.start, p.end)]
            v = [round((1 - w) * atlas.shape[0]) for w in (p.top, p.bottom)]
            parts.append(atlas[v[0] : v[1], u[0] : u[1]])
            assert (atlas[v[0], u[0] - 2 : u[0]] == atlas[v[0], u[0]]).all()
        assert np.array_equal(np.concatenate(parts, 1), surface.texels)


def test_collision_is_counted_and_the_car_respawns():
    simulation = Simulation(load_arena("hallway", 0), 0)
    assert simulation.take_placed() == simulation.pose
    assert simulation.take_placed() is None
    simulation.place(16.5, 0.0, 0.0)
    simulation.take_placed()
    SafeDrive(simulation, simulation).send(DriveCommand(0.5, 0.0))
    simulation.wait_until(4.0)
    (hit,) = simulation.collisions
    assert hit.x == pytest.approx(18.0 - 0.25, abs=0.01)  # the front of the body at the end wall
    x, y, _ = simulation.take_placed()
    assert simulation.plan.clearance(np.array([[x, y]]))[0] > 0.5
    assert simulation.pose == (x, y, simulation.car.heading)
    assert simulation.car.speed == 0.0
    simulation.close()


def test_a_pedestrian_is_seen_and_hit():
    simulation = Simulation(load_arena("room", 2), 2, pedestrian=True)
    first = simulation.pedestrian_at
    simulation.wait_until(1.0)
    assert math.dist(first, simulation.pedestrian_at) == pytest.approx(0.4, abs=0.05)
    x, y = simulation.pedestrian_at
    assert not simulation.collisions
    simulation.place(x, y, 0.0)
    simulation.wait_until(1.1)
    assert len(simulation.collisions) == 1
    assert math.dist(simulation.pose[:2], simulation.pedestrian_at) > 1.0
    simulation.close()


def test_noisy_odometry():
    exact, noisy = (Simulation(load_arena("hallway", 0), 0, odometry=kind) for kind in ("true", "noisy"))
    for simulation in (exact, noisy):
        SafeDrive(simulation, simulation).send(DriveCommand(0.5, 0.0))
        simulation.wait_until(1.0)
    a, b = exact.driven(), noisy.driven()
    assert b.speed == pytest.approx(1.01 * a.speed)
    assert b.speed * b.curvature == pytest.approx(math.radians(0.05))
    exact.close()
    noisy.close()
