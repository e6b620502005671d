"""
A model as a program
====================

``ndtorch.export.export`` writes a model as two programs that ``torch.export`` loads: one for the first chunk of frames,
and one for every chunk after it. The state goes from one to the next as a list of tensors.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import torch

import ndtorch
from ndtorch.export import export
from ndtorch.scenes import two_bars
from ndtorch.vision import FEATURES

# %%
# Small frames and short chunks, so that this takes seconds.
scene = two_bars(seconds=1, size=(100, 100))
model = ndtorch.load("scale-free", size=scene.size)
folder = Path(tempfile.mkdtemp())
first_file, next_file = export(model, folder, frames=2)
print(first_file.name, next_file.name)

# %%
# The same frames through the programs and through the model. The program returns the signals, then the state.
first, following = (torch.export.load(file).module() for file in (first_file, next_file))
from_program, from_model, kept, state = [], [], [], None
with torch.inference_mode():
    for frames in scene.chunks(2):
        frames = frames.float()
        made = following(frames, *kept) if kept else first(frames)
        signals, state = model(frames, state)
        kept = made[len(signals) :]
        from_program.append(made[signals._fields.index("outputs")])
        from_model.append(signals.outputs)
difference = (torch.cat(from_program) - torch.cat(from_model)).abs().max()
print(f"largest difference {float(difference):.1e}")

# %%
# Ten outputs, one for each feature, in the colors of the features where they have one.
colors = [*plt.colormaps["tab10"].colors[:7], "red", "green", "blue"]
times = [k / scene.fps for k in range(len(torch.cat(from_program)))]
figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
for outputs, name, color in zip(torch.cat(from_program).T, FEATURES, colors, strict=True):
    axes.plot(times, outputs, color=color, label=name)
axes.set(xlabel="time (s)", ylabel="output (no unit)", title="outputs of the exported program")
figure.legend(*axes.get_legend_handles_labels(), loc="outside right center", title="neuron")
plt.show()
