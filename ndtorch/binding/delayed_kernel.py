"""A network with delayed feedback, by a kernel: the same numbers as `network_step`, sooner."""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.binding.activations import cube, linear, tanh_10, tanh_pi
from ndtorch.binding.learning import Constants, NetworkState
from ndtorch.binding.rules import LARGEST, LearningRule
from ndtorch.kernels.delayed_network import delayed_network
from ndtorch.kernels.switch import kernels_wanted

FUNCTIONS = (linear, cube, tanh_pi, tanh_10)
"""Those that the kernel knows, in its order."""


def fits(inputs: Tensor, state: NetworkState, constants: Constants) -> bool:
    """Whether a network can go to the kernel with inputs `[T, N]`."""
    c, rule = constants, constants.rule
    known = rule is None or (
        type(rule) is LearningRule
        and rule.row in FUNCTIONS
        and rule.column in FUNCTIONS
        and torch.as_tensor(rule.gamma).numel() == 1
    )
    return (
        known
        and c.feedback == "delayed"
        and not c.shared
        and not c.faint
        and c.when_full == "rescale"
        and inputs.ndim == 2
        and inputs.dtype in (torch.float32, torch.float64)
        and all(part.dtype == inputs.dtype for part in (state.weights, state.outputs, state.mean_weights))
        and kernels_wanted(inputs, *state)
    )


def delayed_steps(
    inputs: Tensor, state: NetworkState, constants: Constants, a_in: float, a_rough: float
) -> tuple[Tensor, NetworkState] | None:
    """Outputs `[T, N]` and the state after them; None where the kernel cannot do it.

    That is where a network does not fit, or where the spectral radius of its weights cannot be told with certainty.

    Args:
        a_in, a_rough: of the filters that are no part of `network_step`.
    """
    if not fits(inputs, state, constants):
        return None
    from ndtorch.kernels.delayed_network import DelayedNumbers

    c, rule, steps = constants, constants.rule, len(inputs)
    factors, limits, begun = inputs.new_empty(0), (LARGEST, float("inf"), 0, 0), steps
    if rule is not None:
        assert isinstance(rule, LearningRule)
        # The rule sees o(t + dt) at the time t.
        seconds = torch.arange(steps, dtype=torch.float64) + int(state.steps)
        seconds = seconds * c.dt - c.settle
        begun = int((seconds <= 0).sum())
        factors = (rule.rate(seconds).reshape(-1) * c.dt).to(inputs.dtype)
        factors[:begun] = -1
        bounded = rule.radius_limit < float("inf")
        functions = (FUNCTIONS.index(rule.row), FUNCTIONS.index(rule.column))
        limits = (LARGEST if bounded else float("inf"), rule.radius_limit, *functions)
    numbers = DelayedNumbers(a_in, c.output_low.a, c.a_mean, a_rough, *limits)
    outputs, shifts = torch.empty_like(inputs), inputs.new_empty(steps)
    weights, mean = state.weights.clone(), state.mean_weights.clone()
    neurons = torch.stack((state.outputs, state.input_low, state.output_low, state.power, state.roughness))
    arrays = [part.numpy() for part in (weights, neurons, mean)]
    run = delayed_network
    done = run(inputs.contiguous().numpy(), 0, factors.numpy(), *arrays, numbers, outputs.numpy(), shifts.numpy())
    if done < steps:
        return None
    out, input_low, output_low, power, roughness = neurons.unbind()
    count = state.steps + steps
    after = state._replace(
        weights=weights,
        outputs=out,
        input_low=input_low,
        output_low=output_low,
        clock=torch.zeros_like(state.clock) + count,
        mean_weights=mean,
        changes=torch.cat((state.changes, shifts[begun:]))[-len(state.changes) :],
        power=power,
        roughness=roughness,
        steps=count,
    )
    return outputs, after
