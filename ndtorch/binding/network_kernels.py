"""Inhibitory networks by kernels: the same numbers as `network_step`."""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.binding._kernels import DelayedNumbers, RuleNumbers, delayed_network, shared_network
from ndtorch.binding.learning import Constants, NetworkState, network_step
from ndtorch.binding.rules import LARGEST, LearningRule, ScaleFreeRule, cube, linear, tanh_10, tanh_pi
from ndtorch.utils.backend import Backend, kernels_wanted

FUNCTIONS = (linear, cube, tanh_pi, tanh_10)
"""Those that the kernel knows, in its order."""


def gammas(rule: object) -> list[Tensor]:
    """The rule's gamma where it is a tensor, which may need a gradient."""
    gamma = getattr(rule, "gamma", None)
    return [gamma] if isinstance(gamma, Tensor) else []


def delayed_fits(inputs: Tensor, state: NetworkState, constants: Constants, backend: Backend) -> bool:
    """Whether a network with delayed feedback can go to the kernel with inputs `[T, N]`."""
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
        and kernels_wanted(inputs, *state, *gammas(rule), backend=backend)
    )


def delayed_steps(
    inputs: Tensor, state: NetworkState, constants: Constants, shares: tuple[float, float], backend: Backend
) -> tuple[Tensor, NetworkState] | None:
    """Outputs `[T, N]` and the state after them; None where the kernel cannot do it.

    That is where a network does not fit, or where the spectral radius of its weights cannot be told with certainty.

    Args:
        shares: of the filters that are no part of `network_step`, those of inputs and of roughness.
    """
    if not delayed_fits(inputs, state, constants, backend):
        return None
    a_in, a_rough = shares
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
    done = delayed_network(
        inputs.contiguous().numpy(), 0, factors.numpy(), *arrays, numbers, outputs.numpy(), shifts.numpy()
    )
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


def shared_fits(inputs: Tensor, state: NetworkState, constants: Constants, backend: Backend) -> bool:
    """Whether a network that fields share can go to the kernel with inputs `[T, F, N]`."""
    c = constants
    kind = c.shared and c.feedback == "settled" and c.every == 1 and c.settle == 0 and c.faint > 0
    return (
        kind
        and type(c.rule) is ScaleFreeRule
        and c.when_full == "rescale"
        and inputs.ndim == 3
        and inputs.dtype in (torch.float32, torch.float64)
        and all(part.dtype == inputs.dtype for part in (state.weights, state.output_low, state.mean_weights))
        and kernels_wanted(inputs, *state, backend=backend)
    )


def shared_steps(
    inputs: Tensor, state: NetworkState, constants: Constants
) -> tuple[Tensor, NetworkState, list[Tensor]]:
    """Outputs `[T, F, N]`, the state after them, and the summed changes of the mean weights at every step."""
    c, rule, now = constants, constants.rule, state
    assert isinstance(rule, ScaleFreeRule)
    names = RuleNumbers._fields[RuleNumbers._fields.index("gamma") :]
    numbers = RuleNumbers(
        c.dt, c.faint, c.output_low.a, c.mean_square.a, c.a_mean, *(float(getattr(rule, name)) for name in names)
    )
    steps, done = len(inputs), 0
    outputs, shifts = torch.empty_like(inputs), torch.zeros(steps, dtype=inputs.dtype)
    drive = inputs.contiguous()
    while done < steps:
        parts = [part.clone() for part in (now.weights, now.output_low, now.fluctuation, now.clock, now.mean_weights)]
        arrays = [part.numpy() for part in parts]
        arrays[3] = arrays[3].reshape(1)
        done = shared_network(drive.numpy(), done, *arrays, numbers, outputs.numpy(), shifts.numpy())
        weights, low, fluctuation, clock, mean = parts
        now = now._replace(weights=weights, output_low=low, fluctuation=fluctuation, clock=clock, mean_weights=mean)
        if done < steps:
            # Weights that may be too large: this step is made with all care.
            out, now, shift = network_step(drive[done : done + 1], now, c, None)
            outputs[done : done + 1] = out
            shifts[done] = 0 if shift is None else shift
            done += 1
    return outputs, now, list(shifts.unbind(0))
