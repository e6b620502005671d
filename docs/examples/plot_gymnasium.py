"""
A policy of your own in Gymnasium
=================================

Simulated drives are environments of Gymnasium. Here a small policy is scored beside the controller ``ranging`` and
beside driving straight on. This needs ``ndtorch-robot[sim]``.
"""

from collections.abc import Callable

import gymnasium
import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.collections import LineCollection

from ndtorch.navigation import Navigator, StereoRanging
from ndtorch_robot.gym import register, strips_of
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.simulation import RIG

Policy = Callable[[dict[str, np.ndarray]], tuple[float, float]]

# %%
# A policy is made anew for every episode. It takes an observation, the subfield and the horizon row of each
# camera, and gives a speed in m/s and a curvature in 1/m. The first one ignores it.


def straight() -> Policy:
    """Straight on."""
    return lambda seen: (0.5, 0.0)


# %%
# The small policy ranges the features of the rows and turns away from the side of the nearest one. A row gives
# one or two ranges a frame, so they decay slowly.


def away() -> Policy:
    """Away from the nearer side."""
    ranging, state, near = StereoRanging(RIG, dt=1 / 30), None, np.zeros(2)

    def policy(seen: dict[str, np.ndarray]) -> tuple[float, float]:
        nonlocal state, near
        left, right = strips_of(seen)
        ranges, state = ranging(left.row, right.row, state)
        x, y = ranges.x[ranges.valid].numpy(), ranges.y[ranges.valid].numpy()
        nearness = 1 / np.hypot(x, y)
        near = np.maximum(0.95 * near, [nearness[side].max(initial=0.0) for side in (y > 0, y < 0)])
        return 0.5, float(np.clip(3 * (near[1] - near[0]), -2.2, 2.2))

    return policy


# %%
# The controller ``ranging`` uses the floor as well, remembers what it saw, and can stop and drive backwards.


def navigator() -> Policy:
    """The navigator with its defaults."""
    model, state = Navigator(RIG, dt=1 / 30), None

    def policy(seen: dict[str, np.ndarray]) -> tuple[float, float]:
        nonlocal state
        command, state = model(*strips_of(seen), state)
        return float(command.speed[-1]), float(command.curvature[-1])

    return policy


# %%
# All drive in the same buildings from the same starts. The reward is the metres driven on new ground, less 10 for a
# collision, which ends the episode.
POLICIES = {"straight on": straight, "away": away, "ranging": navigator}
ARENAS, SECONDS = ("Curve", "Loop", "Room"), 12.0


def episode(env: gymnasium.Env, policy: Policy) -> tuple[float, np.ndarray, bool]:
    """The reward, the path and whether it ended in a collision."""
    seen, info = env.reset(seed=0)
    score, path, hit, over = 0.0, [info["pose"]], False, False
    while not (hit or over):
        action = np.clip(policy(seen), env.action_space.low, env.action_space.high)
        seen, reward, hit, over, info = env.step(action.astype(np.float32))
        score += float(reward)
        path.append(info["pose"])
    return score, np.array(path[:-1] if hit else path), hit  # after a collision the car is put elsewhere


register()  # Gymnasium knows of ndtorch/Curve-v0 and the others from now on
driven = {}
with torch.inference_mode():
    for arena in ARENAS:
        env = gymnasium.make(f"ndtorch/{arena}-v0", building=0, max_episode_steps=round(30 * SECONDS))
        for name, make in POLICIES.items():
            driven[arena, name] = episode(env, make())
            print(f"{arena}, {name}: {driven[arena, name][0]:.2f}")
        env.close()

# %%
# The paths between the walls. A cross is a collision. The small policy sees too little to turn in time: it hits a wall
# in all three.
figure, all_axes = plt.subplots(1, len(ARENAS), figsize=(11, 4.2), layout="constrained")
for axes, arena in zip(all_axes, ARENAS, strict=True):
    for name, color in zip(POLICIES, ("tab:gray", "tab:orange", "tab:blue"), strict=True):
        score, path, hit = driven[arena, name]
        axes.plot(path[:, 0], path[:, 1], color=color, label=f"{name}: {score:.1f}")
        if hit:
            axes.plot(*path[-1, :2], "x", color="tab:red")
    axes.add_collection(LineCollection(load_arena(arena.lower(), seed=0).segments, colors="black", linewidths=2))
    paths = np.concatenate([driven[arena, name][1][:, :2] for name in POLICIES])
    middle, reach = (paths.max(0) + paths.min(0)) / 2, np.ptp(paths, 0).max() / 2 + 1.5
    axes.set(xlim=middle[0] + reach * np.array([-1, 1]), ylim=middle[1] + reach * np.array([-1, 1]), aspect="equal")
    axes.set_title(arena)
    axes.set_xlabel("x (m)")
    axes.legend(title="reward", fontsize="small")
all_axes[0].set_ylabel("y (m)")
plt.show()
