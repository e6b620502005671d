"""
Learning the time constants of motion detectors
===============================================

A time constant given as a ``torch.nn.Parameter`` is learned. A detector with known time constants stands for a recorded
cell; gradient descent recovers them from its responses to moving bars. ``ndtorch.Sequential`` hands the states of its
modules on, so the same network also runs chunk by chunk.
"""

import matplotlib.pyplot as plt
import torch
from torch import nn

from ndtorch import HassensteinReichardt, Sequential


class Total(nn.Module):
    """The sum over the field of each of the four images."""

    def forward(self, images):
        return images.mean((-2, -1))


# %%
# Bars that move to the right at 8 to 30 pixels a second, 50 frames a second.
DT = 0.02
columns, t = torch.arange(24.0), torch.arange(0, 0.8, DT)
speeds = torch.tensor([8.0, 15.0, 30.0])
phase = (columns - speeds[:, None, None] * t[:, None]) / 24
films = (0.5 + 0.4 * torch.sin(2 * torch.pi * phase))[:, :, None, None].expand(-1, -1, 1, 2, -1)


def detector(tau_high, tau_low):
    return Sequential(HassensteinReichardt(DT, tau_high, tau_low), Total())


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
# The same network frame by frame: the state goes in and comes out.
state, outputs = None, []
with torch.no_grad():
    for frame in films.unbind(1):
        out, state = model(frame.unsqueeze(1), state)
        outputs.append(out)
    at_once, _ = model(films)
print(f"largest difference {float((torch.cat(outputs, 1) - at_once).abs().max()):.1e}")

# %%
high, low = zip(*history, strict=True)
figure, axes = plt.subplots(figsize=(7, 3.5), layout="constrained")
axes.plot(high, ".-", label="tau_high")
axes.plot(low, ".-", label="tau_low")
for tau in (0.4, 0.08):
    axes.axhline(tau, color="0.4", ls=":")
axes.set(xlabel="step of the optimiser", ylabel="time constant (s)", title="dotted: the recorded detector")
axes.legend()
plt.show()
