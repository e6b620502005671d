"""The published model: two stages of networks with delayed feedback, objects read from the weights. [B, C]"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import torch
from pydantic import Field
from torch import Tensor

from ndtorch.binding.first_stage import FirstStage
from ndtorch.binding.models.whole_field import BindingState, WholeFieldConfig, WholeFieldModel
from ndtorch.binding.network import InhibitoryNetwork, NetworkState, alternation, weight_change
from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.owners import object_table
from ndtorch.binding.rules import RULES, Rule, learning_rule
from ndtorch.config import Constants, constant
from ndtorch.errors import InputError


class PublishedNetwork(Constants):
    """The four networks; the three of the first stage do not learn."""

    dt: float = constant(0.01, "Time step and delay of the feedback, seconds.", gt=0)
    rule: str = constant(
        "competitive", "Learning rule: competitive, cooperative, hebbian, or a name of your own in RULES."
    )
    f: str = constant("cube", "Expansive function of the rule.")
    g: str = constant("tanh-pi", "Compressive function of the rule.")
    gamma: float = constant(0.5, "Learning rate of the second stage, 1/s.", ge=0)
    tau_in: float = constant(1.0, "High-pass on the inputs of the second stage, seconds.", ge=0)
    tau_out: float = constant(0.5, "High-pass on the outputs in the learning rule, seconds.", ge=0)
    settle: float = constant(4.0, "Time before the second stage learns, seconds.", ge=0)
    tau_onset: float = constant(2.0, "Soft start of learning, seconds.", ge=0)
    radius_limit: float = constant(0.95, "Limit on the spectral radius of the second stage.", gt=0, lt=1)


class WeightReadout(Constants):
    """Objects from weights [C §4.1], and what they are worth."""

    smallest_weight: float = constant(1 / 3, "Ratio to the largest weight from which on a weight counts.", ge=0)
    smallest_column: float = constant(0.6, "Sum of such weights of a neuron that makes it an owner.", ge=0)
    learned_weight: float = constant(0.6, "Largest weight from which on a network has learned.", ge=0)
    stable_window: float = constant(1.0, "Window tau_s of the stability criterion, seconds.", gt=0)
    stable_mean: float = constant(2.0, "Time constant of the mean weights of the stability criterion, seconds.", ge=0)
    stable_change: float = constant(0.5, "Threshold S_thr of the stability criterion, weight per window.", gt=0)
    tau_alternation: float = constant(0.5, "Memory of the outputs' power and of its alternating part, seconds.", gt=0)
    # Smooth signals have 0.001, white noise 0.5, a locked network 0.96 and more.
    alternating: float = constant(0.25, "Ratio of alternating power that only the delay makes.", gt=0)


class PublishedConfig(WholeFieldConfig):
    """Constants of the model; the defaults are the published ones. [B §2; C §2, §4]"""

    model: Literal["published"] = constant("published", "Kind of the model.")
    network: PublishedNetwork = Field(default_factory=PublishedNetwork)
    readout: WeightReadout = Field(default_factory=WeightReadout)


class PublishedModel(WholeFieldModel):
    """The model of the dissertation. [B, C]

    The networks run at their own step of 10 ms, and signals of slower or faster video are interpolated. The second
    stage begins to learn after `settle` seconds.

    Args:
        config: constants.
        first_stage: weights of the three first-stage networks, trained (`FirstStage`) or `[10, 10]`; None for none.
        rule: a learning rule of your own, in place of the config's.
        gamma: learning rates `[...]` in place of the config's, one for every trial of a batch.
    """

    name = "published"
    state_types = (BindingState, NetworkState)
    config_type = PublishedConfig
    config: PublishedConfig

    def __init__(
        self,
        config: PublishedConfig | None = None,
        first_stage: FirstStage | Tensor | None = None,
        rule: Rule | None = None,
        gamma: Tensor | None = None,
    ) -> None:
        c = config or PublishedConfig()
        super().__init__(c, first_stage, c.network.dt)
        # The inputs come high-passed. The three networks are one with weights inside the groups only.
        self.first = InhibitoryNetwork(10, self.dt, None, tau_in=float("inf"), initial=self.first_weights)
        self.second = second_stage(c, gamma)
        self._given_rule: str | None = None
        self._given_gamma = gamma is not None
        if rule is not None:
            self.use_rule(rule)

    def use_rule(self, rule: Rule) -> None:
        """Learn by a rule of your own, in place of the config's."""
        self.second.rule, self._given_rule = rule, rule.name

    def save(self, path: str | Path, overwrite: bool = False) -> None:
        """As in the contract.

        Raises:
            InputError: also for a rule that was given as an object, or rates of every trial: the config has neither.
        """
        if self._given_rule is not None:
            # Never a name that is taken.
            name = "mine" if self._given_rule in RULES else self._given_rule
            raise InputError(
                f"the rule {self._given_rule!r} was given as an object, which no config.toml can name: register its "
                f"maker, ndtorch.binding.rules.RULES[{name!r}] = lambda f, g, **constants: ..., and say rule = {name!r}"
            )
        if self._given_gamma:
            raise InputError("gamma was given for every trial, which no config.toml can hold: set it in the config")
        super().save(path, overwrite)

    def refine(self, inputs: Tensor, state: NetworkState | None) -> tuple[Tensor, NetworkState]:
        refined: tuple[Tensor, NetworkState] = self.first.scan(inputs, state)
        return refined

    def bind(self, refined: Tensor, sums: Tensor, state: NetworkState | None) -> tuple[Tensor, NetworkState]:
        bound: tuple[Tensor, NetworkState] = self.second.scan(refined, state)
        return bound

    def table(self, state: BindingState) -> ObjectTable:
        """The objects, of one trial or a batch, whatever the verdict. [C §4.1]

        None before any weight has reached `learned_weight`: the read-out divides by the largest weight, and makes a
        table of the noise of a network that has learned nothing.
        """
        r, weights = self.config.readout, state.second.weights
        large = weights.amax((-1, -2), keepdim=True) >= r.learned_weight
        return object_table(torch.where(large, weights, 0.0), r.smallest_weight, r.smallest_column)

    def learned(self, state: BindingState) -> tuple[Tensor, Tensor]:
        """As in the contract.

        Stable are weights whose mean changes by at most `stable_change` per `stable_window` [C eq. 5] while one has
        grown far enough to silence another neuron.
        """
        r, second = self.config.readout, state.second
        # Written so that NaN never counts as stable.
        unchanged = weight_change(second) <= r.stable_change
        return ~(alternation(second) <= r.alternating), unchanged & (second.weights.amax((-1, -2)) >= r.learned_weight)


def second_stage(config: PublishedConfig, gamma: float | Tensor | None = None) -> InhibitoryNetwork:
    """The second stage of the published model, untrained.

    Args:
        gamma: learning rates `[...]` in place of the configuration's, one for every trial of a batch.
    """
    n, r = config.network, config.readout
    return InhibitoryNetwork(
        10,
        n.dt,
        rule=config_rule(n, gamma),
        tau_in=n.tau_in,
        tau_out=n.tau_out,
        settle=n.settle,
        window=r.stable_window,
        tau_mean=r.stable_mean,
        tau_rough=r.tau_alternation,
    )


def config_rule(network: PublishedNetwork, gamma: float | Tensor | None = None) -> Rule:
    """The learning rule that a config names, with learning rates in place of its own if they are given."""
    n = network
    if n.rule == "scale-free":
        raise InputError("the rule scale-free has a model of its own: load('scale-free')")
    return learning_rule(
        n.rule,
        f=n.f,
        g=n.g,
        gamma=n.gamma if gamma is None else gamma,
        tau_onset=n.tau_onset,
        radius_limit=n.radius_limit,
    )
