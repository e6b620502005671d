"""
A learning rule of your own
===========================

The rule of the paper multiplies two functions of the outputs: a compressive one of the inhibited neuron and an
expansive one of the inhibiting neuron [B eq. 23]. Any two functions make a rule.
"""

import matplotlib.pyplot as plt
import torch

import ndtorch
from ndtorch.binding import BindingInputs, InhibitoryNetwork, LearningRule
from ndtorch.scenes import two_bars
from ndtorch.vision import FEATURES, VisualFeatures

# %%
# A rule with a fifth power in place of the cube, and a softer compression.
rule = LearningRule(row=torch.arctan, column=lambda x: x**5, name="arctan and fifth power", gamma=2.0)

# %%
# Ten seconds of two bars, once: the sums are all that a rule sees.
features, seen, sums = VisualFeatures(), None, []
with torch.inference_mode():
    for frames in two_bars(seconds=10).chunks(8):
        out, seen = features(frames, seen)
        sums.append(out)
    (inputs, scale), _ = BindingInputs()(torch.cat(sums))
    refined, _ = ndtorch.load("published").first(inputs)

# %%
# Both rules learn from the same signals.
networks = {
    "the published rule": InhibitoryNetwork(10, rule="competitive"),
    rule.name: InhibitoryNetwork(10, rule=rule),
}
figure, panels = plt.subplots(1, 2, figsize=(9, 4.2), layout="constrained")
for (name, network), axes in zip(networks.items(), panels, strict=True):
    with torch.inference_mode():
        _, state = network(refined)
    image = axes.imshow(state.weights, vmin=0, vmax=1, cmap="magma")
    axes.set_xticks(range(10), FEATURES, rotation=90)
    axes.set_yticks(range(10), FEATURES)
    axes.set(xlabel="inhibiting neuron", ylabel="inhibited neuron")
    axes.set_title(f"{name}: largest {float(state.weights.max()):.2f}")
figure.colorbar(image, ax=panels, label="weight")
plt.show()
