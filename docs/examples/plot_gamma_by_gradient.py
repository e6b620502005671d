"""
Fitting the learning rate by gradient
=====================================

Every step of the networks can be differentiated, the learning included. Here the learning rate itself is fitted:
after five seconds of one source seen by two neurons, the weight should be 0.7.
"""

import math

import matplotlib.pyplot as plt
import torch

from ndtorch.binding import InhibitoryNetwork, learning_rule

# %%
# One source, received by both neurons with different strength [C fig. 7].
t = torch.arange(0.0, 5.0, 0.01)
source = torch.sin(2 * math.pi * t)
mixed = torch.stack([0.7 * source, 0.6 * source], -1)

# %%
# Twenty steps of gradient descent through all 500 steps of the network.
gamma = torch.tensor(0.2, requires_grad=True)
optimiser = torch.optim.Adam([gamma], lr=0.15)
history = []
for _ in range(20):
    network = InhibitoryNetwork(2, rule=learning_rule("competitive", gamma=gamma, tau_onset=0.0), settle=0.0)
    _, state = network(mixed)
    loss = (state.weights.max() - 0.7) ** 2
    optimiser.zero_grad()
    loss.backward()
    optimiser.step()
    history.append((gamma.item(), state.weights.max().item()))
print(f"gamma {history[-1][0]:.2f} gives a weight of {history[-1][1]:.2f}")

# %%
rates, weights = zip(*history, strict=True)
figure, (above, below) = plt.subplots(2, 1, figsize=(7, 5), sharex=True, layout="constrained")
above.plot(rates, ".-")
above.set(ylabel="learning rate (1/s)", title="gradient descent on the learning rate")
below.plot(weights, ".-", label="after 5 s of learning")
below.axhline(0.7, color="0.4", ls=":", label="target")
below.set(xlabel="step of the optimiser", ylabel="largest weight")
below.legend()
plt.show()
