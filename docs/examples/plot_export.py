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
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
axes.plot(torch.cat(from_program))
axes.set(xlabel="frame", ylabel="output (no unit)", title="outputs of the program")
plt.show()
