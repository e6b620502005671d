"""
Stimuli of your own
===================

An array, a generator of frames or a formula is a stimulus. Here two discs drift apart, and each changes its brightness
at a rate of its own: the network binds color and motion of each.
"""

import matplotlib.pyplot as plt
import torch

import ndtorch
from ndtorch.scenes import FrameSource

# %%
# A generator of frames ``[3, H, W]``, 0 to 1: twelve seconds at 50 frames a second, on a torus of 100 x 100 pixels.
SIZE, FPS = 100, 50
rows, columns = torch.meshgrid(torch.arange(SIZE), torch.arange(SIZE), indexing="ij")


def disc(row, column, radius=7.0):
    across = (columns - column + SIZE / 2) % SIZE - SIZE / 2
    return torch.sigmoid(2 * (radius - torch.hypot(rows - row, across)))


def frames():
    for t in torch.arange(0, 12, 1 / FPS).tolist():
        red = (0.55 + 0.35 * torch.sin(torch.tensor(5.5 * t))) * disc(30, 20 * t)
        blue = (0.55 + 0.35 * torch.sin(torch.tensor(8.0 * t + 1))) * disc(70, -20 * t)
        yield torch.stack([red, torch.zeros_like(red), blue])


source = FrameSource.from_array(frames(), fps=FPS, name="two-discs")

# %%
model = ndtorch.load("scale-free", size=SIZE, fps=FPS)
state, outputs = None, []
with torch.inference_mode():
    for chunk in source.chunks(25):
        signals, state = model(chunk, state)
        outputs.append(signals.outputs)
for found in model.objects(state):
    print(found.color, found.features)
print(model.verdict(state))

# %%
# Signals of a chunk as a labelled table of xarray.
print(signals.to_xarray().outputs.sel(signal=["right", "left", "red", "blue"])[-1])

# %%
time = torch.arange(len(torch.cat(outputs))) / FPS
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained", width_ratios=[1, 2])
left.imshow(chunk[-1].permute(1, 2, 0))
left.set(title="last frame", xlabel="column (pixels)", ylabel="row (pixels)")
for name, color in (("left", "0.7"), ("right", "0.4"), ("red", "tab:red"), ("blue", "tab:blue")):
    right.plot(time, torch.cat(outputs)[:, ndtorch.FEATURES.index(name)], color=color, lw=1, label=name)
right.set(title="outputs of the network", xlabel="time (s)", ylabel="output")
right.legend(ncols=4)
plt.show()
