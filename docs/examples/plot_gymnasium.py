"""
A policy trained in Gymnasium
=============================

Simulated drives are environments of Gymnasium. Here a policy of four numbers learns to drive along a bent corridor from what
the cameras see, by the cross-entropy method. This needs ``ndtorch-robot[sim]`` and OpenGL through EGL or OSMesa.
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
# The environment is a corridor around a block, in an arena of our own. All episodes are in building 0. The seed of an episode
# says where in it the car starts. The reward is the meters driven; a collision costs 5 and ends the episode.
folder = Path(tempfile.mkdtemp())
(folder / "ring.toml").write_text("""
name = "ring"
rooms = [[0, 0, 5, 1.6], [0, 0, 1.6, 5], [0, 3.4, 5, 5], [3.4, 0, 5, 5]]
height = 1.0
""")
env = gymnasium.make("ndtorch/Drive-v0", arena=str(folder / "ring.toml"), building=0, seconds=8.0)
ranging = RowRanging(RIG, dt=1 / 30)

# %%
# The policy sees three numbers: how near the nearest feature is to the left, ahead and to the right. A row holds one or two
# ranges a frame, so that what was seen fades over some frames. The curvature is a weighted sum of them; the speed is 0.6 m/s.
SIDE = np.radians(12)  # what is farther to a side is not ahead


def episode(weights: np.ndarray, seed: int) -> float:
    """The reward of one drive."""
    seen, _ = env.reset(seed=seed)
    near, state, total, over = np.zeros(3), None, 0.0, False
    while not over:
        left, right = eyes_of(seen)
        ranges, state = ranging(left.row, right.row, state)
        x, y = ranges.x[ranges.valid].numpy(), ranges.y[ranges.valid].numpy()
        near *= 0.9
        for k, angle in enumerate(np.arctan2(y, x)):
            sector = int(angle < SIDE) + int(angle < -SIDE)
            near[sector] = max(near[sector], 1 / np.hypot(x[k], y[k]))
        curvature = np.clip(weights @ np.append(near, 1.0), -2.2, 2.2)
        seen, reward, terminated, truncated, _ = env.step(np.array([0.6, curvature], np.float32))
        total, over = total + reward, terminated or truncated
    return total


# %%
# The cross-entropy method draws policies, keeps the best, and draws the next ones around them. All policies of a generation
# drive from the same start.
rng = np.random.default_rng(0)
mean, spread, history = np.zeros(4), np.ones(4), []
with torch.inference_mode():
    for generation in range(6):
        drawn = mean + spread * rng.standard_normal((10, 4))
        scores = np.array([episode(weights, generation) for weights in drawn])
        best = drawn[np.argsort(scores)[-3:]]
        mean, spread = best.mean(0), best.std(0) + 0.1
        history.append(scores)
        print(f"generation {generation}: mean {scores.mean():.2f}, best {scores.max():.2f}")

    # Starts that the training did not use.
    before = [episode(np.zeros(4), seed) for seed in range(100, 105)]
    after = [episode(mean, seed) for seed in range(100, 105)]
print("weights", mean.round(2))
print(f"reward on five other starts: {np.mean(before):.2f} straight on, {np.mean(after):.2f} trained")
env.close()

# %%
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for generation, scores in enumerate(history):
    axes.plot(np.full(len(scores), generation), scores, "o", color="tab:blue", alpha=0.5)
axes.plot([scores.mean() for scores in history], color="tab:blue")
axes.set_xlabel("generation")
axes.set_ylabel("reward (m)")
plt.show()
