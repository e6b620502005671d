"""
The navigator on stereo pairs
=============================

The navigator takes two images and gives a speed and a curvature. It reads one pixel row and one subfield of each. Here
the pairs come from two folders of images, one a camera. Put the paths of yours in their place. Making the images of
this example needs ``ndtorch-robot[sim]``.
"""

import tempfile
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np
import torch

from ndtorch.navigation import Navigator
from ndtorch.scenes import open_video
from ndtorch_robot.ports import DriveCommand
from ndtorch_robot.safety import SafeDrive
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.simulation import RIG, Simulation

# %%
# The images of this example: a simulated car stands still for a moment, then drives straight on through a hallway.
folder = Path(tempfile.mkdtemp())
world = Simulation(load_arena("hallway"), seed=4, full_frames=True)
drive = SafeDrive(world, clock=world)
for camera in ("left", "right"):
    (folder / camera).mkdir()
for k in range(90):
    frames = world.read()
    for camera, frame in (("left", frames.left), ("right", frames.right)):
        image = frame[0].permute(1, 2, 0).numpy()[..., ::-1]  # OpenCV writes blue, green, red
        cv2.imwrite(str(folder / camera / f"{k:03}.png"), image)
    drive.send(DriveCommand(0.0 if k < 5 else 0.5, 0.0))
    world.wait_until((k + 1) / 30)
world.close()

# %%
# The rig says where the cameras are. Images are taken in the order of their numbers.
left = open_video(folder / "left", size=(RIG.height, RIG.width), fps=30)
right = open_video(folder / "right", size=(RIG.height, RIG.width), fps=30)
navigator = Navigator(RIG, dt=1 / left.fps)
state, ahead, aside, certain = None, [], [], []
with torch.inference_mode():
    for left_frame, right_frame in zip(left.chunks(1), right.chunks(1), strict=True):
        command, state = navigator(left_frame, right_frame, state)
        ahead.append(state.ranges.x[state.ranges.valid])
        aside.append(state.ranges.y[state.ranges.valid])
print(f"speed {float(command.speed):.2f} m/s, curvature {float(command.curvature):.2f} 1/m")

# %%
# The last left image with the horizon row, and all ranges from above: both walls of the hallway, and the edges of its
# doors.
figure, (seen, plan) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
seen.imshow(left_frame[0].permute(1, 2, 0))
seen.axhline(RIG.height / 2, color="white", ls="--", lw=1)
seen.set(title="left camera, horizon row dashed", xlabel="column (pixels)", ylabel="row (pixels)")
plan.plot(np.concatenate(aside), np.concatenate(ahead), ".")
plan.plot(0, 0, "^", color="black", label="car")
plan.set(title="ranges", xlabel="left of the car (m)", ylabel="ahead of the car (m)", aspect="equal")
plan.invert_xaxis()
plan.legend()
plt.show()
