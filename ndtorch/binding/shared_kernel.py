"""A network that fields share, by a kernel: the same numbers as `network_step`, sooner."""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.binding.learning import Constants, NetworkState, network_step
from ndtorch.binding.rules import ScaleFreeRule
from ndtorch.kernels.shared_network import shared_network
from ndtorch.kernels.switch import kernels_wanted


def fits(inputs: Tensor, state: NetworkState, constants: Constants) -> bool:
    """Whether a network can go to the kernel with inputs `[T, F, N]`."""
    c = constants
    kind = c.shared and c.feedback == "settled" and c.every == 1 and c.settle == 0 and c.faint > 0
    return (
        kind
        and type(c.rule) is ScaleFreeRule
        and c.when_full == "rescale"
        and inputs.ndim == 3
        and inputs.dtype in (torch.float32, torch.float64)
        and all(part.dtype == inputs.dtype for part in (state.weights, state.output_low, state.mean_weights))
        and kernels_wanted(inputs, *state)
    )


def by_kernel(inputs: Tensor, state: NetworkState, constants: Constants) -> tuple[Tensor, NetworkState, list[Tensor]]:
    """Outputs `[T, F, N]`, the state after them, and the summed changes of the mean weights at every step."""
    from ndtorch.kernels.shared_network import RuleNumbers

    c, rule, now = constants, constants.rule, state
    assert isinstance(rule, ScaleFreeRule)
    names = RuleNumbers._fields[RuleNumbers._fields.index("gamma") :]
    numbers = RuleNumbers(
        c.dt, c.faint, c.output_low.a, c.mean_square.a, c.a_mean, *(float(getattr(rule, name)) for name in names)
    )
    steps, done = len(inputs), 0
    outputs, shifts = torch.empty_like(inputs), torch.zeros(steps, dtype=inputs.dtype)
    run = shared_network
    drive = inputs.contiguous()
    while done < steps:
        parts = [part.clone() for part in (now.weights, now.output_low, now.fluctuation, now.clock, now.mean_weights)]
        arrays = [part.numpy() for part in parts]
        arrays[3] = arrays[3].reshape(1)
        done = run(drive.numpy(), done, *arrays, numbers, outputs.numpy(), shifts.numpy())
        weights, low, fluctuation, clock, mean = parts
        now = now._replace(weights=weights, output_low=low, fluctuation=fluctuation, clock=clock, mean_weights=mean)
        if done < steps:
            # Weights that may be too large: this step is made with all care.
            out, now, shift = network_step(drive[done : done + 1], now, c, None)
            outputs[done : done + 1] = out
            shifts[done] = 0 if shift is None else shift
            done += 1
    return outputs, now, list(shifts.unbind(0))
