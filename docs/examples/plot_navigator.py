"""
The navigator on stereo pairs
=============================

The navigator takes two images and gives a speed and a curvature. It reads one pixel row and one patch of each. Here the
pairs come from two folders of pictures, one a camera. Put the paths of yours in their place.
"""

import tempfile
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import torch

from ndtorch.navigation import Navigator, StereoRig
from ndtorch.scenes import open_video

# %%
# The pictures of this example: both cameras see the same texture slide past, the right one 100 pixels further on.
# That is a wall 1.3 m away.
folder = Path(tempfile.mkdtemp())
generator = torch.Generator().manual_seed(0)
texture = torch.randint(0, 256, (480, 1000, 3), generator=generator, dtype=torch.uint8).numpy()
for eye, shift in (("left", 0), ("right", 100)):
    (folder / eye).mkdir()
    for k in range(30):
        at = 3 * k + shift
        cv2.imwrite(str(folder / eye / f"{k:03}.png"), texture[:, at : at + 640])

# %%
# Pictures are taken in the order of their numbers.
rig = StereoRig(baseline=0.30, focal=430.0, width=640, height=480)
left = open_video(folder / "left", size=(rig.height, rig.width), fps=30)
right = open_video(folder / "right", size=(rig.height, rig.width), fps=30)
navigator = Navigator(rig, dt=1 / left.fps)
state, ranges = None, []
with torch.inference_mode():
    for left_frame, right_frame in zip(left.chunks(1), right.chunks(1), strict=True):
        command, state = navigator(left_frame, right_frame, state)
        ranges.append(state.ranges.x[state.ranges.valid])
print(f"speed {float(command.speed):.2f} m/s, curvature {float(command.curvature):.2f} 1/m")

# %%
# The ranges, measured forward from between the cameras, m.
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
axes.hist(torch.cat(ranges), bins=40, range=(0.5, 2.5))
axes.set_xlabel("distance ahead (m)")
axes.set_ylabel("features")
plt.show()
