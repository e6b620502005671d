"""
What the detectors answer to
============================

Every detector of ``ndtorch.vision`` on the same stimuli; its largest response is 1.
"""

import matplotlib.pyplot as plt
import torch

from ndtorch.vision import (
    NDS,
    BarlowLevick,
    HassensteinReichardt,
    LoomingDetector,
    NDMin,
    NDMinus,
    OrientedDoG,
    SmallTargetDetector,
)

# %%
# Stimuli of one second on 101 x 101 pixels, 100 frames a second, at a pixel a degree.
DT, SIZE = 0.01, (101, 101)
t, x = torch.arange(0, 1, DT), torch.arange(101.0) - 50
distance = torch.hypot(x, x[:, None])
place = (x - (60 * t - 30)[:, None])[:, None].expand(-1, 101, -1)  # right at 60 pixels a second
size = (0.1 / (1.3 - t)).rad2deg()[:, None, None]  # of a disc that would collide .3 s after the end


def edge(signed_distance):
    return torch.sigmoid(2 * signed_distance)


stimuli = {
    "edge to the right": edge(place),
    "edge to the left": edge(place.flip(-1)),
    "long bar": edge(place.abs() - 4),
    "target of 2 pixels": 1 - (place.abs() < 1) * (x.abs()[:, None] < 1.5).float(),
    "looming disc": edge(distance - size),
    "receding disc": edge(distance - size.flip(0)),
    "flicker": (0.5 + 0.5 * torch.sin(60 * t))[:, None, None].expand(-1, 101, 101),
}

# %%
# The mean response over pixels, or that of the neuron, at its largest after the first fifth of the second.
detectors = {
    "HassensteinReichardt: right less left": (HassensteinReichardt(DT, border="reflect"), lambda y: y[:, 1] - y[:, 0]),
    "BarlowLevick: right less left": (BarlowLevick(DT, border="reflect"), lambda y: y[:, 1] - y[:, 0]),
    "NDMin": (NDMin(dt=DT), torch.abs),
    "NDMinus": (NDMinus(dt=DT), torch.abs),
    "NDS": (NDS(dt=DT), torch.abs),
    "OrientedDoG: 0°": (OrientedDoG(SIZE, border="reflect"), lambda y: y[:, 0].abs()),
    "SmallTargetDetector": (SmallTargetDetector(DT), lambda y: y),
    "LoomingDetector": (LoomingDetector(SIZE, DT), lambda y: y),
}
table = torch.zeros(len(detectors), len(stimuli))
for row, (detector, read) in zip(table, detectors.values(), strict=True):
    for n, film in enumerate(stimuli.values()):
        out = detector(film.unsqueeze(1))
        response = read(out[0] if isinstance(out, tuple) else out)[20:]
        row[n] = response.flatten(1).mean(1).max() if response.ndim > 1 else response.max()
table /= table.amax(1, keepdim=True)

# %%
figure, axes = plt.subplots(figsize=(8.5, 4.5), layout="constrained")
axes.imshow(table, vmin=0, vmax=1, cmap="Blues", aspect="auto")
for (row, column), value in zip(torch.cartesian_prod(*map(torch.arange, table.shape)), table.flatten(), strict=True):
    axes.text(column, row, f"{value:.2f}", ha="center", va="center", color="white" if value > 0.6 else "black")
axes.set_xticks(range(len(stimuli)), stimuli, rotation=30, ha="right")
axes.set_yticks(range(len(detectors)), detectors)
plt.show()
