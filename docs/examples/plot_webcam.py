"""
A camera, live
==============

A camera is a source of frames like a file. Where there is none, this example says so and takes a generated scene
instead. ``ndtorch bind camera:0`` takes a camera too.
"""

import matplotlib.pyplot as plt
import torch

import ndtorch
from ndtorch.errors import InputError
from ndtorch.scenes import FrameSource, open_video, two_bars

# %%
# Three seconds of the first camera. ``open_video`` raises an error that says what is wrong.
source: FrameSource
try:
    source = open_video(0, size=(224, 224), fit="reduce", stop=75)
except InputError as error:
    print(f"{error}. A generated scene takes its place.")
    source = two_bars(seconds=3, fps=25, size=(200, 200))

# %%
# Frames go through the model as they come; a live source gives each of them once.
model = ndtorch.load("figures", size=source.size, fps=source.fps)
state, count = None, 0
with torch.inference_mode():
    for frames in source.chunks(4):
        signals, state = model(frames, state)
        count += len(frames)
things = list(model.objects(state))
print(f"{count} frames, {len(things)} objects")
for thing in things:
    print(f"{thing.first_seen:.1f} to {thing.last_seen:.1f} s: {thing.color}, {thing.direction}")

# %%
# The last frame, and the way of each object in it.
figure, axes = plt.subplots(figsize=(5, 5), layout="constrained")
axes.imshow(frames[-1].permute(1, 2, 0))
for thing in things:
    times, columns, rows = zip(*thing.path, strict=True)
    axes.plot(columns, rows, "w.-")
axes.set_axis_off()
plt.show()
