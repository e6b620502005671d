"""The environment is a drive: the same cameras, car and collisions, by Gymnasium's rules."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

pytest.importorskip("gymnasium")

import gymnasium
from gymnasium.utils.env_checker import check_env

from ndtorch_robot.gym import CONTACT, DriveEnv, register, strips_of
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.simulation import RIG, Simulation

AHEAD = np.array([0.5, 0.0], np.float32)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A room that is built in a moment."""
    file = tmp_path_factory.mktemp("arena") / "small.toml"
    file.write_text('name = "small"\nrooms = [[0, 0, 3, 3]]\nheight = 1.0\n')
    return str(file)


@pytest.fixture(scope="module")
def env(small: str) -> Iterator[DriveEnv]:
    """Building 7; every test resets it."""
    with DriveEnv(small, building=7) as env:
        yield env


def test_it_is_the_simulation(env: DriveEnv, small: str) -> None:
    seen, told = env.reset(seed=3)
    drawn = int(np.random.default_rng(3).integers(2**31))
    simulation = Simulation(load_arena(small, 7), 7, fields=env.fields)
    simulation.begin(drawn)
    left, right = strips_of(seen)
    frames = simulation.read()
    for eye, same in ((left, frames.left), (right, frames.right)):
        assert np.array_equal(eye.field, same.field)
        assert np.array_equal(eye.row, same.row)
    assert told["pose"] == pytest.approx(simulation.pose)


def test_the_same_seed_is_the_same_episode_in_the_building_that_stands(env: DriveEnv) -> None:
    runs = []
    for seed in (3, 4, 3):
        seen, told = env.reset(seed=seed)
        start, total = told["pose"], 0.0
        kept = env.simulation
        for _ in range(15):
            seen, reward, terminated, truncated, told = env.step(AHEAD)
            total += reward
            assert not terminated
            assert not truncated
        assert total == pytest.approx(float(np.hypot(*(told["pose"] - start)[:2])), abs=1e-6)
        assert total == pytest.approx(0.5 * 0.5 - 0.05, abs=0.01)  # less what the start takes, v^2 / 2a
        runs.append((seen["fields"], tuple(told["pose"])))
    assert env.simulation is kept
    assert np.array_equal(runs[0][0], runs[2][0])
    assert runs[0][1] == runs[2][1] != runs[1][1]


def test_a_wall_ends_it_and_backward_costs(env: DriveEnv) -> None:
    env.reset(seed=0)
    assert sum(env.step(-AHEAD)[1] for _ in range(10)) < -0.05
    rewards, terminated = [], False
    while not terminated and len(rewards) < 200:
        _, reward, terminated, _, told = env.step(np.array([1.0, 0.0], np.float32))
        rewards.append(reward)
    assert terminated
    assert told["collisions"] == 1
    assert -CONTACT - 0.05 < rewards[-1] < 0.05 - CONTACT
    assert min(rewards[10:-1]) > 0


def test_circles_bring_nothing(env: DriveEnv) -> None:
    env.reset(seed=0)
    env.simulation.place(1.5, 1.0, 0.0)  # type: ignore[union-attr]
    rounds = [sum(env.step(np.array([0.9, 2.0], np.float32))[1] for _ in range(105)) for _ in range(2)]  # pi m each
    assert rounds[0] > 2.0
    assert rounds[1] < 0.2


def complaints(env: gymnasium.Env[Any, Any], **how: bool) -> list[str]:
    """What Gymnasium's checker says of it, but for the unit of actions: they are m/s and 1/m."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        check_env(env, **how)
    return [str(one.message) for one in said if "symmetric and normalized" not in str(one.message)]


def test_the_checker_is_content(env: DriveEnv) -> None:
    assert complaints(env, skip_render_check=True, skip_close_check=True) == []


def test_many_at_once(small: str) -> None:
    register()
    register()  # a second time does no harm
    envs = gymnasium.make_vec("ndtorch/Drive-v0", 2, vectorization_mode="sync", arena=small, building=7)
    assert envs.spec is not None
    assert envs.spec.max_episode_steps == 1800
    seen, _ = envs.reset(seed=1)
    assert seen["rows"].shape == (2, 6 * RIG.width)
    assert not np.array_equal(seen["rows"][0], seen["rows"][1])
    _, rewards, *_ = envs.step(np.stack((AHEAD, 0 * AHEAD)))
    assert rewards[0] > rewards[1] == 0
    envs.close()
