"""
Your own video
==============

The model ``foreground`` finds objects over time, with a box and a silhouette each. Here the clip is rendered first; put
the path of yours in its place.
``ndtorch bind my-video.mp4`` uses the same model and writes a report.
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
# A model is made for the size and the rate of its frames. ``reduce`` keeps the whole image at 224 rows.
# ``mask`` is 1 at the pixels of confirmed objects.
state = None
with open_video(clip, size=(224, 224), fit="reduce") as video, torch.inference_mode():
    model = ndtorch.load("foreground", size=video.size, fps=video.fps)
    for frames in video.chunks(4):
        signals, state = model(frames, state)
for found in model.objects(state):
    left, top, right, bottom = found.box
    print(f"{found.first_seen:.1f} to {found.last_seen:.1f} s: {found.color}, {found.direction}, ", end="")
    print(f"last at columns {left:.0f} to {right:.0f}, rows {top:.0f} to {bottom:.0f}")

# %%
# The last frame with the foreground mask outlined, and the path of each object.
figure, (seen, paths) = plt.subplots(1, 2, figsize=(9, 4.5), layout="constrained")
seen.imshow(frames[-1].permute(1, 2, 0))
seen.contour(signals.mask[-1] > 0, levels=[0.5], colors="white")
seen.set(title="last frame, outlined", xlabel="column (pixels)", ylabel="row (pixels)")
for found in model.objects(state):
    times, columns, rows = zip(*found.path, strict=True)
    paths.plot(columns, rows, ".-", color=f"tab:{found.color}", label=f"{found.color}, {found.direction}")
paths.set(
    xlim=(0, video.size[1]),
    ylim=(video.size[0], 0),
    xlabel="column (pixels)",
    ylabel="row (pixels)",
    title="paths",
    aspect="equal",
)
paths.legend()
plt.show()
