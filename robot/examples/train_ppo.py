"""PPO of Stable-Baselines3 learns to drive, and is compared with `ranging` and with straight on in unseen buildings.

It sees what `ranging` remembers around the car, and commands for four frames at a time. This needs
`ndtorch-robot[sim]` and `stable-baselines3`.

    python robot/examples/train_ppo.py 24000 ppo.png    # trains for so many commands, and draws the rewards
"""

import sys
from pathlib import Path

import gymnasium
import matplotlib.pyplot as plt
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

from ndtorch.navigation import Command, Navigator
from ndtorch_robot.gym import register, strips_of
from ndtorch_robot.obstacles import nearest_by_sector, seen_obstacles
from ndtorch_robot.sim.simulation import RIG

ARENA, TRAINING, UNSEEN = "Loop", range(8), (1000, 1001, 1002)
FRAMES = 4
"""Frames that a command of the policy lasts."""

SECTORS = 24
MIDDLE, HALF_RANGE = np.array([0.25, 0.0], np.float32), np.array([0.35, 2.0], np.float32)
"""Of the actions: speeds from -.1 to .6 m/s, and curvatures of the car."""


class Sectors(gymnasium.Wrapper):
    """Nearness (1/m) of what `ranging` remembers in 24 sectors, and odometry; actions in -1..1."""

    def __init__(self, env: gymnasium.Env) -> None:
        super().__init__(env)
        self.observation_space = gymnasium.spaces.Box(-3, 3, (SECTORS + 2,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1, 1, (2,), np.float32)
        self.navigator, self.state = Navigator(RIG, dt=1 / 30), None

    def observation(self, seen: dict[str, np.ndarray], info: dict) -> np.ndarray:
        driven = Command(*(torch.tensor([float(value)]) for value in info["driven"]))
        with torch.inference_mode():
            _, self.state = self.navigator(*strips_of(seen), self.state, driven)
        places = seen_obstacles(self.state, self.navigator)
        near = 1 / nearest_by_sector(places.x, places.y, SECTORS).clip(1 / 3)
        return np.concatenate((near, info["driven"])).astype(np.float32)

    def reset(self, **given) -> tuple[np.ndarray, dict]:
        self.state = None
        seen, info = self.env.reset(**given)
        return self.observation(seen, info), info

    def step(self, action: np.ndarray) -> tuple:
        asked, total = MIDDLE + HALF_RANGE * np.clip(action, -1, 1), 0.0
        for _ in range(FRAMES):
            seen, reward, hit, over, info = self.env.step(asked)
            found, total = self.observation(seen, info), total + float(reward)
            if hit or over:
                break
        return found, total, hit, over, info


def make(building: int) -> gymnasium.Env:
    """One building."""
    return gymnasium.make(f"ndtorch/{ARENA}-v0", building=building)


def score(act, building: int, sectors: bool) -> tuple[float, bool]:
    """Reward of an episode, and whether it ended in a wall."""
    env = Sectors(make(building)) if sectors else make(building)
    seen, _ = env.reset(seed=building)
    total, hit, over = 0.0, False, False
    while not (hit or over):
        seen, reward, hit, over, _ = env.step(act(seen))
        total += float(reward)
    env.close()
    return total, hit


def ranging():
    """The navigator with its defaults."""
    navigator, state = Navigator(RIG, dt=1 / 30), None

    def act(seen: dict[str, np.ndarray]) -> np.ndarray:
        nonlocal state
        command, state = navigator(*strips_of(seen), state)
        return np.array([float(command.speed[-1]), float(command.curvature[-1])], np.float32)

    return act


def learn(commands: int) -> tuple[PPO, list[tuple[int, float]]]:
    """The policy, and frames driven with the mean reward of the last hundred episodes."""
    envs = VecMonitor(DummyVecEnv([lambda building=building: Sectors(make(building)) for building in TRAINING]))
    given = {"n_steps": 128, "batch_size": 128, "gamma": 0.97, "ent_coef": 0.0}
    model = PPO("MlpPolicy", envs, **given, policy_kwargs={"log_std_init": -0.7}, seed=0)
    curve = []
    while model.num_timesteps < commands:
        model.learn(2048, reset_num_timesteps=False)
        mean = float(np.mean([episode["r"] for episode in model.ep_info_buffer] or [np.nan]))
        curve.append((FRAMES * model.num_timesteps, mean))
        print(f"{curve[-1][0]} frames: mean reward {mean:.2f}", flush=True)
    envs.close()
    return model, curve


def draw(curve: list[tuple[int, float]], rewards: dict[str, list[float]], file: Path) -> None:
    """Rewards while it learned, and those of all in unseen buildings as lines."""
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    axes.plot(
        *np.array(curve).T / [[1000], [1]], color="tab:blue", label="PPO with exploration noise, training buildings"
    )
    for (name, values), color in zip(rewards.items(), ("tab:blue", "tab:gray", "tab:orange"), strict=True):
        axes.axhline(np.mean(values), color=color, linestyle="--", label=f"{name}, unseen buildings")
    axes.set(xlabel="thousand frames", ylabel="mean reward of an episode", title=f"ndtorch/{ARENA}-v0")
    axes.legend()
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    torch.set_num_threads(1)
    register()
    model, curve = learn(int(sys.argv[1]) if len(sys.argv) > 1 else 24_000)
    policies = {
        "PPO": (lambda: lambda seen: model.predict(seen, deterministic=True)[0], True),
        "straight on": (lambda: lambda seen: np.array([0.5, 0.0], np.float32), False),
        "ranging": (ranging, False),
    }
    rewards = {}
    for name, (policy, sectors) in policies.items():
        with torch.inference_mode():
            found = [score(policy(), building, sectors) for building in UNSEEN]
        rewards[name] = [reward for reward, _ in found]
        hits = sum(hit for _, hit in found)
        print(f"{name}: {', '.join(f'{r:.1f}' for r in rewards[name])}; mean {np.mean(rewards[name]):.1f}, {hits} hits")
    draw(curve, rewards, Path(sys.argv[2] if len(sys.argv) > 2 else "ppo.png"))
