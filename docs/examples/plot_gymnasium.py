"""
A policy trained in Gymnasium
=============================

Simulated drives are environments of Gymnasium. Here a policy of two numbers learns to drive around two bends by what
the cameras see. It is trained by the cross-entropy method. This needs ``ndtorch-robot[sim]`` and OpenGL through EGL or
OSMesa.
"""

import tempfile
from pathlib import Path

import gymnasium
import matplotlib.pyplot as plt
import numpy as np
import torch

from ndtorch.navigation import RowRanging
from ndtorch_robot.gym.environment import eyes_of
from ndtorch_robot.sim.simulation import RIG

# %%
# A corridor with a bend to the left and one to the right. The number of the building says what its walls look like. The
# reward is the meters driven; a collision costs 5 and ends the episode.
arena = Path(tempfile.mkdtemp()) / "bends.toml"
arena.write_text("""
name = "bends"
rooms = [[0, 0, 3.6, 1.8], [1.8, 0, 3.6, 4.2], [1.8, 2.4, 7.2, 4.2]]
start = [1.2, 0.9, 0]
height = 1.0
""")


def make(building: int) -> gymnasium.Env:
    """The environment of one building."""
    return gymnasium.make("ndtorch/Drive-v0", arena=str(arena), building=building, seconds=8.0)


# %%
# The policy sees how near the nearest feature is to the left and to the right. A row holds one or two ranges a frame,
# so what was seen fades slowly. The curvature is a weighted sum of the difference between the sides and of 1. The speed
# is 0.6 m/s.
ranging = RowRanging(RIG, dt=1 / 30)
FADES, SIDE = 0.95, np.radians(12)


def episode(env: gymnasium.Env, weights: np.ndarray) -> float:
    """The reward of one drive."""
    seen, _ = env.reset(seed=0)
    near, state, total, over = np.zeros(2), None, 0.0, False
    while not over:
        left, right = eyes_of(seen)
        ranges, state = ranging(left.row, right.row, state)
        x, y = ranges.x[ranges.valid].numpy(), ranges.y[ranges.valid].numpy()
        angles, nearness = np.arctan2(y, x), 1 / np.hypot(x, y)
        sides = (angles > SIDE, angles < -SIDE)
        near = np.maximum(FADES * near, [nearness[side].max(initial=0.0) for side in sides])
        curvature = weights @ (near[1] - near[0], 1.0)
        seen, reward, terminated, truncated, _ = env.step(np.clip([0.6, curvature], -2.2, 2.2).astype(np.float32))
        total, over = total + float(reward), terminated or truncated
    return total


# %%
# The cross-entropy method draws policies, keeps the best three, and draws the next ones around them.
rng = np.random.default_rng(0)
mean, spread, history = np.zeros(2), np.array([4.0, 1.0]), []
with torch.inference_mode():
    env = make(building=0)
    for generation in range(4):
        drawn = mean + spread * rng.standard_normal((8, 2))
        scores = np.array([episode(env, weights) for weights in drawn])
        best = drawn[np.argsort(scores)[-3:]]
        mean, spread = best.mean(0), best.std(0) + 0.1
        history.append(scores)
        print(f"generation {generation}: mean {scores.mean():.2f}, best {scores.max():.2f}")
    env.close()
print("weights", mean.round(2))

# %%
# Walls that the training has not seen.
with torch.inference_mode():
    for building in (1, 2, 3):
        env = make(building)
        print(f"building {building}: straight on {episode(env, np.zeros(2)):.2f}, trained {episode(env, mean):.2f}")
        env.close()

# %%
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for generation, scores in enumerate(history):
    axes.plot(np.full(len(scores), generation), scores, "o", color="tab:blue", alpha=0.5)
axes.plot([scores.mean() for scores in history], color="tab:blue")
axes.set_xticks(range(len(history)))
axes.set_xlabel("generation")
axes.set_ylabel("reward (m)")
plt.show()
