"""PPO of Stable-Baselines3 learns to drive, and is compared with `ranging` and with straight on in unseen buildings.

It sees means of what the cameras see. This needs `ndtorch-robot[sim]` and `stable-baselines3`. The defaults of
Stable-Baselines3 work, too, with what `gymnasium.make` gives, `PPO("MultiInputPolicy", env)`; they take hours.

    python robot/examples/train_ppo.py 30000    # trains for so many steps
"""

import sys
from functools import partial

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

from ndtorch.navigation import Navigator
from ndtorch_robot.gym import register
from ndtorch_robot.gym.environment import strips_of
from ndtorch_robot.sim.simulation import RIG

ARENA, TRAINING, UNSEEN = "Loop", (0, 1, 2, 3), (1000, 1001, 1002)
SMALL = np.array([0.5, 0.0], np.float32), np.array([0.5, 2.0], np.float32)
"""Middle and half range of the actions: speeds from 0 to 1 m/s, and curvatures of the car."""


class Small(gymnasium.ObservationWrapper, gymnasium.ActionWrapper):
    """Means of grey values, 80 of each row and 7 x 14 of each patch, and actions in -1..1."""

    def __init__(self, env: gymnasium.Env) -> None:
        super().__init__(env)
        self.observation_space = gymnasium.spaces.Box(0, 1, (2 * 80 + 2 * 7 * 14,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1, 1, (2,), np.float32)

    def observation(self, seen: dict[str, np.ndarray]) -> np.ndarray:
        rows = seen["rows"].reshape(2, 3, 80, 8).mean((1, 3))
        fields = seen["fields"]
        tall, wide = fields.shape[1] // 7, fields.shape[2] // 14
        cells = fields[:, : 7 * tall, : 14 * wide].reshape(2, 3, 7, tall, 14, wide).mean((1, 3, 5)) / 255
        return np.concatenate((rows.ravel(), cells.ravel())).astype(np.float32)

    def action(self, action: np.ndarray) -> np.ndarray:
        return SMALL[0] + SMALL[1] * np.clip(action, -1, 1)

    def step(self, action: np.ndarray) -> tuple:
        seen, *rest = self.env.step(self.action(action))
        return self.observation(seen), *rest


def make(building: int) -> gymnasium.Env:
    """One building."""
    return gymnasium.make(f"ndtorch/{ARENA}-v0", building=building)


def score(act, building: int, small: bool) -> tuple[float, bool]:
    """Reward of an episode, and whether it ended in a wall."""
    env = Small(make(building)) if small else make(building)
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


if __name__ == "__main__":
    torch.set_num_threads(1)
    register()
    envs = VecMonitor(DummyVecEnv([partial(lambda building: Small(make(building)), building) for building in TRAINING]))
    model = PPO("MlpPolicy", envs, n_steps=256, batch_size=128, gamma=0.98, ent_coef=0.002, seed=0)
    steps, done = int(sys.argv[1]) if len(sys.argv) > 1 else 30_000, 0
    while done < steps:
        model.learn(4096, reset_num_timesteps=False)
        done = model.num_timesteps
        ended = [episode["r"] for episode in model.ep_info_buffer]
        print(
            f"{done} steps, mean reward of the last {len(ended)} episodes {np.mean(ended or [np.nan]):.2f}", flush=True
        )
    for building in UNSEEN:
        learned = score(lambda seen: model.predict(seen, deterministic=True)[0], building, small=True)
        straight = score(lambda seen: np.array([0.5, 0.0], np.float32), building, small=False)
        with torch.inference_mode():
            navigated = score(ranging(), building, small=False)
        for name, (reward, hit) in {"PPO": learned, "straight on": straight, "ranging": navigated}.items():
            print(f"{ARENA} {building}, {name}: reward {reward:.1f}{', hit a wall' * hit}", flush=True)
