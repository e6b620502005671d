"""The three first-stage networks: trained on contracting rings, checked, read and written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ndtorch.arguments import check_number
from ndtorch.binding.network import InhibitoryNetwork, NetworkState
from ndtorch.binding.normalise import BindingInputs
from ndtorch.binding.rules import learning_rule
from ndtorch.errors import InputError
from ndtorch.scenes.patterns import rings
from ndtorch.utils.files import read_tensors, save_tensors
from ndtorch.vision.features import GROUPS, VisualFeatures

LONGEST = 120.0


class FirstStage(NamedTuple):
    """Trained weights of the motion, orientation and color networks, and how long training took.

    Attributes:
        motion, orientation, color: `[4, 4]`, `[3, 3]`, `[3, 3]`: M, O and C of the papers.
        seconds: simulated seconds from the start of the stimulus to the end of the last network's training.
    """

    motion: Tensor
    orientation: Tensor
    color: Tensor
    seconds: float


def first_stage_weights(stage: FirstStage | Tensor) -> Tensor:
    """The `[10, 10]` weights of a trained first stage or of a matrix, if they are usable."""
    weights: Any = torch.block_diag(*stage[:3]) if isinstance(stage, FirstStage) else stage  # type: ignore[no-untyped-call]
    if not isinstance(weights, Tensor) or weights.shape != (10, 10):
        given = tuple(weights.shape) if isinstance(weights, Tensor) else type(weights).__name__
        raise InputError(f"first_stage must be a FirstStage or weights [10, 10], got {given}")
    inside = torch.zeros(10, 10, dtype=torch.bool)
    for group in GROUPS.values():
        inside[group, group] = True
    inside.fill_diagonal_(False)
    if not torch.isfinite(weights).all() or (weights < 0).any() or weights[~inside].any():
        raise InputError(
            "first-stage weights must be finite, non-negative, and zero on the diagonal and between groups"
        )
    return weights


def read_first_stage(path: Path) -> Tensor:
    """The `[10, 10]` first-stage weights in a weights.safetensors with the keys motion, orientation and color."""
    tensors, _ = read_tensors(path, "a safetensors file")
    weights = torch.zeros(10, 10)
    for name, group in GROUPS.items():
        n = group.stop - group.start
        if name not in tensors:
            raise InputError(f"{path} has no weights called {name!r}; it has {', '.join(sorted(tensors)) or 'none'}")
        if tensors[name].shape != (n, n):
            raise InputError(f"{path}: {name} must be [{n}, {n}], got {tuple(tensors[name].shape)}")
        if not tensors[name].is_floating_point():
            raise InputError(f"{path}: {name} must be of floating point, got {tensors[name].dtype}")
        weights[group, group] = tensors[name].float()
    return weights


def write_first_stage(stage: FirstStage | Tensor, path: Path) -> None:
    """What `read_first_stage` reads."""
    weights = first_stage_weights(stage).detach().cpu().float()
    save_tensors({name: weights[group, group].contiguous() for name, group in GROUPS.items()}, path)


def train_first_stage(
    gamma: float = 5.0,
    radius: float = 0.9,
    dt: float = 0.01,
    settle: float = 4.0,
    size: tuple[int, int] = (100, 100),
    report: Callable[[float, list[float]], None] | None = None,
) -> FirstStage:
    """Show the networks the ring stimulus until the spectral radius of each reaches `radius`. [B §2.3, eq. 25-27]

    The rings drive all features of a group alike, so every weight of a network grows at about the same pace; each
    network stops for itself. The orientation filters are as large as the 100 x 100 stimulus, and how their tails
    wrap around its edges sets how alike the orientation weights come out.

    Args:
        gamma: learning rate of all three, 1/s: 5 in [B], 50 in [C].
        radius: spectral radius at which a network stops, below 1.
        dt: time step and time between frames, seconds.
        settle: seconds of stimulus before learning.
        size: of the stimulus, pixels.
        report: called with the simulated seconds and the largest weight of each network.

    Raises:
        InputError: gamma or radius out of range, or a network that does not get there within two minutes.
    """
    check_number("gamma", gamma, above=0, unit="1/s")
    check_number("radius", radius, above=0)
    if radius >= 1:
        raise InputError(f"radius must lie between 0 and 1, got {radius}")
    features = VisualFeatures(size, dt, exact=True)
    inputs = BindingInputs(dt)
    networks = [
        InhibitoryNetwork(
            group.stop - group.start,
            dt,
            learning_rule("competitive", gamma=gamma, radius_limit=radius),
            # Filter first: the inputs come high-passed.
            tau_in=float("inf"),
            settle=settle,
            when_full="stop",
        )
        for group in GROUPS.values()
    ]
    seen = input_state = None
    states: list[NetworkState | None] = [None] * len(networks)
    seconds = 0.0
    with torch.no_grad():
        for frames in rings(seconds=LONGEST, size=size, fps=1 / dt).chunks(25):
            sums, seen = features(frames, seen)
            (signals, _), input_state = inputs(sums, input_state)
            for i, (network, group) in enumerate(zip(networks, GROUPS.values(), strict=True)):
                _, states[i] = network(signals[..., group], states[i])
            seconds += frames.shape[-4] * dt
            now = [state for state in states if state is not None]
            if report is not None:
                report(seconds, [float(state.weights.max()) for state in now])
            if all(bool(state.stopped) for state in now):
                motion, orientation, color = (state.weights for state in now)
                return FirstStage(motion, orientation, color, seconds)
    raise InputError(f"the first stage did not reach a spectral radius of {radius} in {LONGEST:g} s; raise gamma")
