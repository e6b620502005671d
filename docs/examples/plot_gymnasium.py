"""
A policy of your own in Gymnasium
=================================

Simulated drives are environments of Gymnasium. Here a small policy is scored beside the controller ``ranging`` and
beside driving straight on. This needs ``ndtorch-robot[sim]`` and OpenGL through EGL or OSMesa.
"""

from collections.abc import Callable

import gymnasium
import matplotlib.pyplot as plt
import numpy as np
import torch

from ndtorch.navigation import Navigator, RowRanging
from ndtorch_robot.gym.environment import eyes_of
from ndtorch_robot.sim.simulation import RIG

Policy = Callable[[dict[str, np.ndarray]], tuple[float, float]]

# %%
# A policy is made anew for every episode. It takes an observation, which is a picture of the floor and a row of each
# eye, and gives a speed in m/s and a curvature in 1/m. The first one looks at nothing.


def straight() -> Policy:
    """Straight on."""
    return lambda seen: (0.5, 0.0)


# %%
# The small policy ranges the features of the rows and turns away from the side where the nearest one is. A row holds
# one or two ranges a frame, so what was seen fades slowly.


def away() -> Policy:
    """Away from the nearer side."""
    ranging, state, near = RowRanging(RIG, dt=1 / 30), None, np.zeros(2)

    def policy(seen: dict[str, np.ndarray]) -> tuple[float, float]:
        nonlocal state, near
        left, right = eyes_of(seen)
        ranges, state = ranging(left.row, right.row, state)
        x, y = ranges.x[ranges.valid].numpy(), ranges.y[ranges.valid].numpy()
        nearness = 1 / np.hypot(x, y)
        near = np.maximum(0.95 * near, [nearness[side].max(initial=0.0) for side in (y > 0, y < 0)])
        return 0.5, float(np.clip(3 * (near[1] - near[0]), -2.2, 2.2))

    return policy


# %%
# The controller ``ranging`` uses the floor as well, remembers what it saw, and can stop and drive backwards.


def navigator() -> Policy:
    """The navigator as it is."""
    model, state = Navigator(RIG, dt=1 / 30), None

    def policy(seen: dict[str, np.ndarray]) -> tuple[float, float]:
        nonlocal state
        command, state = model(*eyes_of(seen), state)
        return float(command.speed[-1]), float(command.curvature[-1])

    return policy


# %%
# All drive from the same starts. The reward is the meters driven, less 5 for a collision, which ends the episode. Which
# building it is, and where in it the car starts, are given by numbers.
POLICIES = {"straight on": straight, "away": away, "ranging": navigator}
paths: dict[str, list[np.ndarray]] = {name: [] for name in POLICIES}
env = gymnasium.make("ndtorch/Curve-v0", building=0, seconds=15.0)
with torch.inference_mode():
    for name, make in POLICIES.items():
        scores = []
        for seed in range(3):
            (seen, info), policy, score, over = env.reset(seed=seed), make(), 0.0, False
            path = [info["pose"]]
            while not over:
                action = np.clip(policy(seen), env.action_space.low, env.action_space.high)
                seen, reward, terminated, truncated, info = env.step(action.astype(np.float32))
                score, over = score + float(reward), terminated or truncated
                path.append(info["pose"])
            scores.append(score)
            paths[name].append(np.array(path[:-1] if terminated else path))  # after a collision the car is put back
        print(f"{name}: {np.mean(scores):.2f} ({', '.join(f'{score:.2f}' for score in scores)})")
env.close()

# %%
# The paths. A cross is a collision.
figure, all_axes = plt.subplots(1, 3, figsize=(9, 3.2), layout="constrained", sharex=True, sharey=True)
for axes, (name, driven) in zip(all_axes, paths.items(), strict=True):
    for path in driven:
        axes.plot(path[:, 0], path[:, 1], color="tab:blue")
        axes.plot(*path[0, :2], "o", color="tab:blue")
        if len(path) < 15 * 30 + 1:
            axes.plot(*path[-1, :2], "x", color="tab:red")
    axes.set_title(name)
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
all_axes[0].set_ylabel("y (m)")
plt.show()
