"""
The navigator on stereo pairs
=============================

The navigator takes two images and gives a speed and a curvature. It reads one pixel row and one patch of each. Here the
images come from a texture that slides past; a folder of your own stereo pairs works the same way.
"""

import matplotlib.pyplot as plt
import torch

from ndtorch.navigation import Navigator, StereoRig

# %%
# Both cameras see the same texture, the right one 100 pixels further on: a wall 1.3 m away.
generator = torch.Generator().manual_seed(0)
texture = torch.randint(0, 256, (3, 480, 1000), generator=generator, dtype=torch.uint8)
pairs = [(texture[None, :, :, 3 * k : 3 * k + 640], texture[None, :, :, 3 * k + 100 : 3 * k + 740]) for k in range(60)]

# %%
rig = StereoRig(baseline=0.30, focal=430.0, width=640, height=480)
navigator = Navigator(rig, dt=1 / 30)
state, ranges = None, []
with torch.inference_mode():
    for left, right in pairs:
        command, state = navigator(left, right, state)
        ranges.append(state.ranges.x[state.ranges.valid])
print(f"speed {float(command.speed):.2f} m/s, curvature {float(command.curvature):.2f} 1/m")

# %%
# The ranges, measured forward from between the cameras, m.
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
axes.hist(torch.cat(ranges), bins=40, range=(0.5, 2.5))
axes.set_xlabel("distance ahead (m)")
axes.set_ylabel("features")
plt.show()
