"""
A model as a program
====================

``ndtorch.export.export`` writes a model as two programs that ``torch.export`` loads: one for the first chunk of frames
and one for every chunk after it. What they need in between is a list of tensors.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import torch

import ndtorch
from ndtorch.export import export
from ndtorch.scenes import two_bars

# %%
folder = Path(tempfile.mkdtemp())
model = ndtorch.load("scale-free")
first_file, next_file = export(model, folder, frames=8)
print(first_file.name, next_file.name)

# %%
# The same frames through the programs and through the model.
first, following = (torch.export.load(file).module() for file in (first_file, next_file))
names = len(model.signals(torch.zeros(8, 3, 500, 500), None)[0])
program_outputs, model_outputs, kept, state = [], [], None, None
with torch.inference_mode():
    for frames in two_bars(seconds=1.6).chunks(8):
        made = first(frames) if kept is None else following(frames, *kept)
        kept = made[names:]
        signals, state = model(frames, state)
        program_outputs.append(made[:names][signals._fields.index("outputs")])
        model_outputs.append(signals.outputs)
difference = (torch.cat(program_outputs) - torch.cat(model_outputs)).abs().max()
print(f"largest difference {float(difference):.1e}")

# %%
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
axes.plot(torch.cat(program_outputs))
axes.set(xlabel="frame", ylabel="output (no unit)", title="outputs of the program")
plt.show()
