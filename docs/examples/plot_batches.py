"""
Clips from a DataLoader
=======================

Many short clips at once: a `torch.utils.data.DataLoader` gives `[B, T, 3, H, W]`, a model takes it as it is, and its
state is that of a batch.
"""

import matplotlib.pyplot as plt
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

import ndtorch
from ndtorch.scenes import moving_bar
from ndtorch.vision import FEATURES


# %%
# A data set of your own: one clip of a bar for each direction. Films: here, by `ndtorch.scenes.open_video`.
class Bars(Dataset[tuple[Tensor, float]]):
    def __len__(self) -> int:
        return 12

    def __getitem__(self, number: int) -> tuple[Tensor, float]:
        direction = 30.0 * number
        return moving_bar(direction, seconds=0.6).frames(0, 60), direction


# %%
# Batches of four clips of 60 frames. Every clip starts at rest; `state` would continue four films in chunks.
model = ndtorch.load("published", size=100)
directions, sums = [], []
with torch.inference_mode():
    for clips, angle in DataLoader(Bars(), batch_size=4):
        signals, state = model(clips)
        print(tuple(clips.shape), tuple(signals.sums.shape), tuple(model.weights(state).shape))
        directions.append(angle)
        sums.append(signals.sums[:, -1])

# %%
# Directional motion of the last frame against the direction of the bar (0 right, 90 up).
motion = torch.cat(sums)[:, :4]
figure, axes = plt.subplots(figsize=(6, 3), layout="constrained")
axes.plot(torch.cat(directions), motion / motion.max(), marker="o", label=FEATURES[:4])
axes.set(xlabel="direction of the bar (degrees)", ylabel="sum over the image / largest")
axes.legend()
plt.show()
