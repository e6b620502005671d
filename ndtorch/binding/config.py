"""Parameters of the binding model, read from and written to TOML with errors that name the key."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ndtorch.binding.models.scale_free import Readout
from ndtorch.binding.normalise import Order
from ndtorch.errors import InputError
from ndtorch.toml import toml_values


class BindingConfig(BaseModel):
    """Constants of the model; the defaults are the published ones. [B §2; C §2, §4]

    Seconds where nothing else is said.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    dt: float = Field(0.01, gt=0, description="time step of the networks")
    tau_motion_high: float = Field(0.5, ge=0, description="high-pass of the motion detectors")
    tau_motion_low: float = Field(0.05, ge=0, description="delay filter of the motion detectors")
    order: Order = Field("filter-first", description="high-pass before or after group normalisation")
    tau_in: float = Field(1.0, ge=0, description="high-pass on every network's inputs")
    tau_out: float = Field(0.5, ge=0, description="high-pass on the outputs in the learning rule")
    window: float = Field(2.0, gt=0, description="memory of the group normalisation")
    floor: float = Field(0.01, ge=0, description="share of a group's level that counts as full fluctuation")
    rule: str = Field("competitive", description="competitive, cooperative, hebbian or scale-free")
    f: str = Field("cube", description="expansive function of the rule")
    g: str = Field("tanh-pi", description="compressive function of the rule")
    gamma: float = Field(0.5, ge=0, description="learning rate of the second stage, 1/s")
    settle: float = Field(4.0, ge=0, description="time before the second stage learns")
    tau_onset: float = Field(2.0, ge=0, description="soft start of learning")
    radius_limit: float = Field(0.95, gt=0, lt=1, description="limit on the second stage's spectral radius")
    stable_window: float = Field(1.0, gt=0, description="tau_s of the stability criterion")
    stable_mean: float = Field(2.0, ge=0, description="time constant of the mean weights it looks at")
    stable_change: float = Field(0.5, gt=0, description="S_thr of the stability criterion, weight per window")
    learned_weight: float = Field(0.6, ge=0, description="smallest largest weight of a network that has learned")
    scale_free_gamma: float = Field(0.2, ge=0, description="scale-free rule: learning rate in the long run, 1/s")
    scale_free_settle: float = Field(0.5, ge=0, description="scale-free rule: time before the second stage learns")
    tau_smooth: float = Field(0.05, ge=0, description="scale-free rule: low-pass on the network's inputs")
    readout: Readout = Field("delays", description="scale-free rule: read objects from owners or from delays")


def validated(data: dict[str, Any], where: str) -> BindingConfig:
    """A config from plain data; one-line `InputError` naming `where` and the key otherwise."""
    try:
        return BindingConfig(**data)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        if first["type"] == "extra_forbidden":
            raise InputError(f"{where}: unknown key {key!r}; known: {', '.join(BindingConfig.model_fields)}") from None
        raise InputError(f"{where}: {key} = {first['input']!r}: {first['msg']}") from None


def read_config(path: Path) -> BindingConfig:
    """Read a model's config.toml.

    Raises:
        InputError: missing or malformed file, unknown key, value out of range.
    """
    return validated(toml_values(path), str(path))
