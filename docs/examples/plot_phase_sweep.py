"""
A batch of scenes: sweeping the phase
=====================================

The two bars of the reference scene are lit by a moving shadow. At which phases between their fluctuations does the
published model separate them? Each bar is rendered once, the films are added up at 64 phases, and all 64 scenes
run through the model as one batch.
"""

import matplotlib.pyplot as plt
import torch

import ndtorch
from ndtorch.binding import BindingInputs, InhibitoryNetwork, learning_rule, object_table
from ndtorch.vision import FEATURES
from ndtorch_train.superposed import film_bars

# %%
# The ten sums of every scene, `[64, 1900, 10]`: 4 s to settle and 15 s to learn, a sample every 10 ms.
phases = [n * 360 / 64 for n in range(64)]
films = film_bars()
sums = films.red(19.0) + films.green(phases, 19.0)
print(sums.shape)

# %%
# One batch through normalisation, and through a second stage that learns each scene for itself.
model = ndtorch.load("published")
with torch.inference_mode():
    signals, state = model.from_sums(sums)
print([len(found) for found in model.objects_batch(state)])

# %%
# How many objects were found, and which. Two bars have two owners, red and green, at most phases.
table = model.table(state)
figure, axes = plt.subplots(figsize=(8, 3), layout="constrained")
axes.imshow(table.owners.T, aspect="auto", cmap="Greys", extent=(-2.8, 357.2, 9.5, -0.5))
axes.set_yticks(range(10), FEATURES)
axes.set(xlabel="phase between the bars (degrees)", ylabel="neuron", title="neurons that own an object (black)")
plt.show()

# %%
# The same pieces by hand, with another learning rate for every scene.
inputs = BindingInputs()
rule = learning_rule("competitive", gamma=torch.linspace(0.1, 2.0, len(phases)))
network = InhibitoryNetwork(10, rule=rule)
with torch.inference_mode():
    (normalised, scale), _ = inputs(sums)
    refined, _ = model.first(normalised)
    outputs, learned = network(refined)
print(object_table(learned.weights).owners.sum(-1))
