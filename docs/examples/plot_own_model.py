"""
A model folder of your own
==========================

A model is a folder. This example saves the published model, changes a constant in its ``config.toml``, and loads it
again by its path. ``ndtorch bind two-bars --model PATH`` takes the same folder.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import torch

import ndtorch
from ndtorch.scenes import two_bars
from ndtorch.vision import FEATURES

# %%
folder = Path(tempfile.mkdtemp()) / "quick"
ndtorch.load("published").save(folder)
print(sorted(path.name for path in folder.iterdir()))

# %%
# Learn at twice the rate, and begin after two seconds instead of four.
config = (folder / "config.toml").read_text()
config = config.replace("gamma = 0.5", "gamma = 1.0").replace("settle = 4.0", "settle = 2.0")
(folder / "config.toml").write_text(config)
model = ndtorch.load(folder)
print(model.config.network.gamma, model.settle)

# %%
state = None
with torch.inference_mode():
    for frames in two_bars(seconds=8).chunks(8):
        signals, state = model(frames, state)
for found in model.objects(state):
    print(found)

# %%
# A column holds the weights by which one neuron inhibits the others: the columns of red and green are the objects.
figure, axes = plt.subplots(figsize=(6, 5), layout="constrained")
image = axes.imshow(model.weights(state), vmin=0, vmax=1, cmap="magma")
figure.colorbar(image, label="weight")
axes.set_xticks(range(10), FEATURES, rotation=90)
axes.set_yticks(range(10), FEATURES)
axes.set(xlabel="inhibiting neuron", ylabel="inhibited neuron", title="weights after 6 s of learning")
plt.show()
