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
model = ndtorch.load("foreground", size=source.size, fps=source.fps)
state, count = None, 0
with torch.inference_mode():
    for frames in source.chunks(4):
        signals, state = model(frames, state)
        count += len(frames)
found = list(model.objects(state))
print(f"{count} frames, {len(found)} objects")
for one in found:
    print(f"{one.first_seen:.1f} to {one.last_seen:.1f} s: {one.color}, {one.direction}")

# %%
# The last frame, and the path of each object. A dot marks where the object was last.
figure, axes = plt.subplots(figsize=(5.5, 5), layout="constrained")
axes.imshow(frames[-1].permute(1, 2, 0))
for one in found:
    times, columns, rows = zip(*one.path, strict=True)
    axes.plot(columns, rows, color="white", ls="--", lw=1)
    axes.plot(columns[-1], rows[-1], "o", label=f"{one.color}, {one.direction}: {times[0]:.1f} to {times[-1]:.1f} s")
axes.set(xlabel="column (pixels)", ylabel="row (pixels)", title="last frame and paths")
if found:
    axes.legend()
plt.show()
