"""
What can be learned
===================

A constant given as a ``torch.nn.Parameter`` is learned: time constants, widths of filters, learning rates. Here
gradient descent recovers the time constants of a recorded motion detector, and finds a learning rate.
"""

import matplotlib.pyplot as plt
import torch
from torch import nn

import ndtorch
from ndtorch import HassensteinReichardt, InhibitoryNetwork, Sequential
from ndtorch.binding import learning_rule

# %%
# Bars that move to the right at 8 to 30 pixels a second, 50 frames a second: a batch of three clips. A detector with
# known time constants stands for a recorded cell. ``ndtorch.Sequential`` hands the states of its modules on.
DT = 0.02
columns, t = torch.arange(24.0), torch.arange(0, 0.8, DT)
speeds = torch.tensor([8.0, 15.0, 30.0])
phase = (columns - speeds[:, None, None] * t[:, None]) / 24
films = (0.5 + 0.4 * torch.sin(2 * torch.pi * phase))[:, :, None, None].expand(-1, -1, 1, 2, -1)


def detector(tau_high, tau_low):
    return Sequential(HassensteinReichardt(DT, tau_high, tau_low), nn.AvgPool2d((2, 24)), nn.Flatten())


recorded, _ = detector(0.4, 0.08)(films)

# %%
# Start somewhere else and follow the gradient. ``named_parameters`` lists both time constants.
tau_high, tau_low = nn.Parameter(torch.tensor(0.15)), nn.Parameter(torch.tensor(0.03))
model = detector(tau_high, tau_low)
print([name for name, _ in model.named_parameters()])
optimiser = torch.optim.LBFGS(model.parameters(), max_iter=4, line_search_fn="strong_wolfe")
history = [(tau_high.item(), tau_low.item())]


def relative_error():
    optimiser.zero_grad()
    response, _ = model(films)
    loss = (response - recorded).square().sum() / recorded.square().sum()
    loss.backward()
    return loss


for _ in range(10):
    loss = optimiser.step(relative_error)
    history.append((tau_high.item(), tau_low.item()))
print(f"tau_high {tau_high.item():.3f} s, tau_low {tau_low.item():.3f} s, relative error {loss.item():.1e}")

# %%
# The gradient passes through learning too. One source, received by two neurons with different strength [C fig. 7]: at
# which rate is the weight 0.7 after five seconds?
source = torch.sin(2 * torch.pi * torch.arange(0.0, 5.0, 0.01))
mixed = torch.stack([0.7 * source, 0.6 * source], -1)
gamma = nn.Parameter(torch.tensor(0.2))
network = InhibitoryNetwork(2, rule=learning_rule("competitive", gamma=gamma, tau_onset=0.0), settle=0.0)
adam, rates = torch.optim.Adam(network.parameters(), lr=0.15), []
for _ in range(20):
    _, state = network(mixed)
    adam.zero_grad()
    (state.weights.max() - 0.7).square().backward()
    adam.step()
    rates.append((gamma.item(), state.weights.max().item()))
print(f"gamma {rates[-1][0]:.2f} gives a weight of {rates[-1][1]:.2f}")

# %%
# Models keep parameters too, and ``save`` writes their values into config.toml.
published = ndtorch.load("published", size=100, gamma=nn.Parameter(torch.tensor(0.5)))
print([name for name, _ in published.named_parameters()], published.learnable)

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.5), layout="constrained")
for name, values, true in zip(("tau_high", "tau_low"), zip(*history, strict=True), (0.4, 0.08), strict=True):
    left.plot(values, ".-", label=name)
    left.axhline(true, color="0.4", ls=":")
left.set(xlabel="step of the optimiser", ylabel="time constant (s)", title="dotted: the recorded detector")
right.plot(rates, ".-", label=["learning rate (1/s)", "weight after 5 s"])
right.axhline(0.7, color="0.4", ls=":")
right.set(xlabel="step of the optimiser", title="dotted: the weight wanted")
left.legend()
right.legend()
plt.show()
