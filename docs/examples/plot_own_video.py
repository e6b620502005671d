"""
Your own video
==============

The model ``video`` finds objects over time. Here the clip is rendered first; put the path of yours in its place.
``ndtorch bind my-video.mp4 --open`` does the same and shows a report.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import torch

import ndtorch
from ndtorch.scenes import open_video, two_bars
from ndtorch.scenes.video_writer import VideoWriter

# %%
clip = Path(tempfile.mkdtemp()) / "clip.mp4"
with VideoWriter(clip, 25, (500, 500)) as film:
    for frames in two_bars(seconds=3, fps=25).chunks():
        for frame in frames:
            film.write(frame)

# %%
# A model is made for the size and the rate of its frames.
state = None
with open_video(clip, size=(200, 200)) as video, torch.inference_mode():
    model = ndtorch.load("video", size=video.size, fps=video.fps)
    for frames in video.chunks(4):
        signals, state = model(frames, state)
for thing in model.objects(state):
    print(f"{thing.first_seen:.1f} to {thing.last_seen:.1f} s: {thing.color}, {thing.direction}")

# %%
# Where each was seen, in pixels.
figure, axes = plt.subplots(figsize=(5, 5), layout="constrained")
for thing in model.objects(state):
    times, columns, rows = zip(*thing.path, strict=True)
    axes.plot(columns, rows, ".-", label=f"{thing.color}, {thing.direction}")
axes.set(xlim=(0, 200), ylim=(200, 0), xlabel="column (pixels)", ylabel="row (pixels)")
axes.legend()
plt.show()
