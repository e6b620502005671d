"""PPO of Stable-Baselines3 learns to drive, and is compared with `ranging` in unseen buildings.

It sees what `ranging` remembers around the car, and commands for four frames at a time. This needs
`ndtorch-robot[sim]` and `stable-baselines3`.

    python robot/examples/train_ppo.py 24000    # trains for so many commands
"""

import sys

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

from ndtorch.navigation import Command, Navigator
from ndtorch_robot.gym import register, strips_of
from ndtorch_robot.navigator_runner import seen_obstacles
from ndtorch_robot.sim.simulation import RIG

ENVIRONMENT, TRAINING, UNSEEN = "ndtorch/Loop-v0", range(8), (1000, 1001, 1002)
SECTORS, FRAMES = 24, 4
"""Directions in which the policy knows the nearest obstacle, and frames that a command lasts."""

MIDDLE, HALF_RANGE = np.array([0.25, 0.0], np.float32), np.array([0.35, 2.0], np.float32)
"""Of the actions: speeds from -.1 to .6 m/s, and curvatures of the car."""


class Sectors(gymnasium.Wrapper):
    """Nearness (1/m) of what `ranging` remembers in 24 sectors, and odometry; actions in -1..1, or None: `ranging`."""

    def __init__(self, env: gymnasium.Env) -> None:
        super().__init__(env)
        self.observation_space = gymnasium.spaces.Box(-3, 3, (SECTORS + 2,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1, 1, (2,), np.float32)
        self.navigator, self.state, self.command = Navigator(RIG, dt=1 / 30), None, None

    def observation(self, strips: dict[str, np.ndarray], info: dict) -> np.ndarray:
        driven = Command(*(torch.tensor([float(value)]) for value in info["driven"]))
        with torch.inference_mode():
            self.command, self.state = self.navigator(*strips_of(strips), self.state, driven)
        obstacles = seen_obstacles(self.state, self.navigator)
        sectors = np.rint(np.arctan2(obstacles.y, obstacles.x) * (SECTORS / (2 * np.pi))).astype(int) % SECTORS
        nearest = np.full(SECTORS, np.inf)
        np.minimum.at(nearest, sectors, np.hypot(obstacles.x, obstacles.y).clip(1 / 3))
        return np.concatenate((1 / nearest, info["driven"])).astype(np.float32)

    def reset(self, **given) -> tuple[np.ndarray, dict]:
        self.state = None
        strips, info = self.env.reset(**given)
        return self.observation(strips, info), info

    def step(self, action: np.ndarray | None) -> tuple:
        total = 0.0
        for _ in range(FRAMES):
            asked = self.command if action is None else MIDDLE + HALF_RANGE * np.clip(action, -1, 1)
            strips, reward, hit, over, info = self.env.step(np.array([float(value) for value in asked], np.float32))
            observation, total = self.observation(strips, info), total + float(reward)
            if hit or over:
                break
        return observation, total, hit, over, info


def score(act, building: int) -> float:
    """Reward of an episode."""
    env = Sectors(gymnasium.make(ENVIRONMENT, building=building))
    observation, _ = env.reset(seed=building)
    total, hit, over = 0.0, False, False
    while not (hit or over):
        observation, reward, hit, over, _ = env.step(act(observation))
        total += reward
    return total


if __name__ == "__main__":
    torch.set_num_threads(1)
    register()
    makers = [
        lambda building=building: Sectors(gymnasium.make(ENVIRONMENT, building=building)) for building in TRAINING
    ]
    given = {"n_steps": 128, "batch_size": 128, "gamma": 0.97, "ent_coef": 0.0, "policy_kwargs": {"log_std_init": -0.7}}
    model = PPO("MlpPolicy", VecMonitor(DummyVecEnv(makers)), **given, seed=0, verbose=1)
    model.learn(int(sys.argv[1]) if len(sys.argv) > 1 else 24_000)
    for name, act in (("PPO", lambda o: model.predict(o, deterministic=True)[0]), ("ranging", lambda o: None)):
        rewards = [score(act, building) for building in UNSEEN]
        print(f"{name}: {', '.join(f'{reward:.1f}' for reward in rewards)}; mean {np.mean(rewards):.1f}")
