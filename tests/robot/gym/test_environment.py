"""The environment is a drive: the same cameras, car and collisions, by Gymnasium's rules."""

from __future__ import annotations

import numpy as np
import pytest
import torch

pytest.importorskip("gymnasium")
pytest.importorskip("mujoco")

import gymnasium
from gymnasium.utils.env_checker import check_env

from ndtorch.errors import InputError
from ndtorch.navigation import Navigator
from ndtorch_robot.gym import ENVIRONMENTS, register
from ndtorch_robot.gym.environment import COLLISION, DriveEnv, eyes_of
from ndtorch_robot.sim.arenas import ARENAS, load_arena
from ndtorch_robot.sim.simulation import RIG, Simulation

AHEAD = np.array([0.5, 0.0], np.float32)


@pytest.mark.long
def test_every_arena_has_an_environment_and_the_checker_is_content() -> None:
    register()
    register()
    assert set(ENVIRONMENTS.values()) == set(ARENAS)
    with gymnasium.make("ndtorch/Curve-v0", seconds=2.0, render_mode="rgb_array") as env:
        assert isinstance(env.unwrapped, DriveEnv)
        check_env(env.unwrapped)
        env.reset(seed=0)
        frame = env.render()
        assert frame.shape == (480, 640, 3)


def test_it_is_the_simulation_and_the_same_seed_is_the_same_episode() -> None:
    env = DriveEnv("curve", seconds=0.5)
    first, told = env.reset(options={"building": 7})
    simulation = Simulation(load_arena("curve", 7), 7, fields=env.fields)
    frames = simulation.read()
    assert np.array_equal(first["left_row"], frames.left.row[0].numpy())
    assert told["pose"] == pytest.approx(simulation.pose)
    simulation.close()
    env.reset(seed=3)
    runs = []
    for _ in range(2):
        seen, _ = env.reset(seed=3)
        total, ends = 0.0, []
        for _ in range(15):
            seen, reward, terminated, truncated, told = env.step(AHEAD)
            total += reward
            ends.append((terminated, truncated))
        runs.append((seen["right_field"], total, tuple(told["pose"])))
        assert ends == [(False, False)] * 14 + [(False, True)]
    assert np.array_equal(runs[0][0], runs[1][0])
    assert runs[0][1:] == runs[1][1:]
    start = env.reset(seed=3)[1]["pose"]
    assert runs[0][1] == pytest.approx(float(np.hypot(*(runs[0][2][:2] - start[:2]))), abs=0.02)
    env.close()


def test_a_wall_ends_it() -> None:
    env = DriveEnv("room", seconds=60.0)
    env.reset(options={"building": 1})
    rewards, terminated = [], False
    while not terminated and len(rewards) < 600:
        _, reward, terminated, truncated, told = env.step(np.array([1.0, 0.0], np.float32))
        rewards.append(reward)
    assert terminated
    assert not truncated
    assert told["collisions"] == 1
    assert rewards[-1] < 0.1 - COLLISION
    assert min(rewards[:-1]) >= 0
    env.close()


def test_a_navigator_drives_it_and_frames_hold_the_strips() -> None:
    navigator, state = Navigator(RIG, 1 / 30), None
    strips, frames = DriveEnv("curve"), DriveEnv("curve", observation="frames")
    seen, _ = strips.reset(seed=5)
    whole, _ = frames.reset(seed=5)
    assert np.array_equal(whole["left"][:, RIG.row], seen["left_row"][:, 0])
    with torch.inference_mode():
        for _ in range(20):
            command, state = navigator(*eyes_of(seen), state)
            seen, *_ = strips.step(np.array([float(command.speed[-1]), float(command.curvature[-1])], np.float32))
    assert float(command.speed[-1]) > 0.1
    strips.close()
    frames.close()


def test_many_at_once() -> None:
    register()
    envs = gymnasium.make_vec("ndtorch/Curve-v0", num_envs=2, vectorization_mode="sync")
    seen, _ = envs.reset(seed=1)
    assert seen["left_row"].shape == (2, 3, 1, 640)
    assert not np.array_equal(seen["left_row"][0], seen["left_row"][1])
    _, rewards, *_ = envs.step(np.stack((AHEAD, 0 * AHEAD)))
    assert rewards[0] > rewards[1] == 0
    envs.close()


def test_what_cannot_be_made_is_refused() -> None:
    for values in ({"arena": "nowhere"}, {"observation": "sound"}, {"render_mode": "human"}, {"seconds": 0.0}):
        with pytest.raises(InputError):
            DriveEnv(**values)
    with pytest.raises(InputError, match="reset"):
        DriveEnv("curve").step(AHEAD)
