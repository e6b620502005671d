"""Tuning curves: responses of the detectors to drifting gratings over a grid, and the formulas that they follow."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.errors import InputError, did_you_mean
from ndtorch.scenes.patterns import Pattern, grating
from ndtorch.vision.barlow_levick import BarlowLevick
from ndtorch.vision.chahl_srinivasan import ChahlSrinivasan
from ndtorch.vision.motion import HassensteinReichardt
from ndtorch.vision.nondirectional import NDS, NDMin, NDMinus
from ndtorch.vision.orientation import OrientedDoG, dog_spectrum
from ndtorch.vision.temporal import Discretization, ratio

Grid = Mapping[str, Tensor]
"""A value of every parameter at each point of a grid, `[N]`."""
PHASES = 8
"""Phases of a grating over which a response is averaged: that of two products of sines is exact from 3 on."""
TURN = 2 * math.pi
DEGREES = [360 * n / PHASES for n in range(PHASES)]


class TuningCurve(NamedTuple):
    """What `tuning_curve` measures.

    Attributes:
        detector: name.
        axes: the parameters that vary, with their values.
        response: of the detector, `[*axes]`.
        formulas: what it should be, by name, `[*axes]` each: with the discrete filters, and with continuous ones.
    """

    detector: str
    axes: dict[str, list[float]]
    response: Tensor
    formulas: dict[str, Tensor]

    def table(self) -> dict[str, list[float]]:
        """A column for each parameter, the response and each formula, a row a point."""
        points = zip(*itertools.product(*self.axes.values()), strict=True)
        columns = {"response": self.response, **self.formulas}
        named = {name: list(values) for name, values in zip(self.axes, points, strict=True)}
        return named | {name: values.flatten().tolist() for name, values in columns.items()}

    def to_xarray(self) -> Any:
        """An `xarray.Dataset` with the parameters as coordinates; needs the extra `xarray`."""
        import xarray

        columns = {"response": self.response, **self.formulas}
        data = {name: (tuple(self.axes), values.numpy()) for name, values in columns.items()}
        return xarray.Dataset(data, coords=self.axes, attrs={"detector": self.detector})


class Detector(NamedTuple):
    """How a detector is measured, its formulas, and the values of its parameters that are not varied."""

    measure: Callable[[Grid, Discretization], Tensor]
    formulas: Mapping[str, Callable[[Grid, Discretization], Tensor]]
    usual: Mapping[str, float]


def tuning_curve(
    detector: str,
    over: Mapping[str, Sequence[float]],
    discretization: Discretization = "euler",
    **constants: float,
) -> TuningCurve:
    """Responses of a detector to drifting sine gratings of mean .5, over the grid of all values in `over`.

    Parameters: temporal_frequency (Hz), wavelength (pixels), direction (degrees), contrast, fps, tau_high and tau_low
    (seconds), speed (pixels a frame, of chahl-srinivasan in place of temporal_frequency).

    - hassenstein-reichardt, barlow-levick: rightward less leftward response of a pair of pixels, mean over time. With
      the gains H and L of high-pass and delay and k = 2 pi cos(direction) / wavelength, Hassenstein-Reichardt gives
      `A^2 |H|^2 (-Im L) sin k`, A = .5 contrast.
    - nd-min, nd-minus, nds: amplitude of a pixel: `A |H|`, times `1 - cos k` of nd-minus, `|1 + 2 L cos k|` of nds.
    - chahl-srinivasan: shift, pixels a frame: `sin(k speed) / sin k`.
    - oriented-dog: amplitude of the filter at 0 degrees: its spectrum [B eq. 14-16].

    Args:
        detector: one of `DETECTORS`.
        over: values of one or more parameters.
        discretization: of the filters, see `smoothing_factor`.
        constants: values of the other parameters.

    Raises:
        InputError: no such detector or parameter.

    >>> curve = tuning_curve("hassenstein-reichardt", {"temporal_frequency": [1.0, 2.5, 6.0]}, fps=30)
    >>> int(curve.response.argmax())
    1
    """
    if detector not in DETECTORS:
        raise InputError(f"detector must be one of {', '.join(DETECTORS)}{did_you_mean(detector, DETECTORS)}")
    kind = DETECTORS[detector]
    for name in (*over, *constants):
        if name not in kind.usual:
            hint = did_you_mean(name, kind.usual) or f"; it has {', '.join(kind.usual)}"
            raise InputError(f"{detector} has no parameter {name}{hint}")
    if not over:
        raise InputError("over must name one parameter or more")
    axes = {name: [float(value) for value in values] for name, values in over.items()}
    points = torch.tensor(list(itertools.product(*axes.values())), dtype=torch.float64).T
    grid = {name: torch.full_like(points[0], {**kind.usual, **constants}[name]) for name in kind.usual}
    grid |= dict(zip(axes, points, strict=True))
    response = torch.zeros_like(points[0])
    # Points whose filters are the same are one batch.
    names = [name for name in ("fps", "tau_high", "tau_low") if name in grid]
    filters = torch.stack([torch.zeros_like(response), *(grid[name] for name in names)])
    for one in torch.unique(filters, dim=1).T:
        some = (filters == one[:, None]).all(0)
        response[some] = kind.measure({name: values[some] for name, values in grid.items()}, discretization)
    shape = tuple(map(len, axes.values()))
    formulas = {name: formula(grid, discretization).reshape(shape) for name, formula in kind.formulas.items()}
    return TuningCurve(detector, axes, response.reshape(shape), formulas)


def sensor(
    kind: Callable[..., nn.Module], read: Callable[[Tensor], Tensor], **options: Any
) -> Callable[[Grid, Discretization], Tensor]:
    """A measurement of a module with filters: `read` of its output when they have settled, `[N, PHASES, C, 2, 5]`."""

    def measure(grid: Grid, discretization: Discretization) -> Tensor:
        fps = float(grid["fps"][0])
        taus = {name: float(grid[name][0]) for name in ("tau_high", "tau_low") if name in grid}
        module = kind(dt=1 / fps, discretization=discretization, **taus, **options)
        film, state = gratings(grid, seconds=12 * (max(taus.values()) + 1 / fps), fps=fps, size=(2, 5)), None
        with torch.inference_mode():
            for frames in film.chunks(64):
                out, state = module(frames.double(), state)
        return read(out[:, :, -1])

    return measure


def pair(out: Tensor) -> Tensor:
    """Rightward less leftward response of a pair of pixels."""
    return (out[:, :, 1] - out[:, :, 0])[:, :, 0, 2].mean(1)


def pixel(out: Tensor) -> Tensor:
    """Amplitude of the middle pixel of a row."""
    return amplitude(out[:, :, 0, 0, 2])


def amplitude(samples: Tensor) -> Tensor:
    """Amplitude of a sine from its values at all phases, `[N, PHASES]`."""
    turn = torch.exp(-2j * math.pi * torch.arange(PHASES, dtype=torch.float64) / PHASES)
    return 2 / PHASES * (samples * turn).sum(1).abs()


def gratings(grid: Grid, **screen: Any) -> Pattern:
    """The grating of each point, in all phases, `[N, PHASES, T, 1, H, W]`."""
    names = ("wavelength", "temporal_frequency", "direction", "contrast")
    terms: Any = {name: grid[name][:, None] for name in names if name in grid}
    return grating(**terms, phase=DEGREES, channels=1, **screen)


def measure_shift(grid: Grid, discretization: Discretization) -> Tensor:
    """Shift of rows that differ in phase."""
    film = gratings({**grid, "temporal_frequency": grid["speed"] / grid["wavelength"]}, seconds=2, fps=1, size=(1, 3))
    rows = film.frames(0, 2)[..., 0, 0, :].double().movedim(1, 2)[:, :, None]
    shift: Tensor = ChahlSrinivasan()(rows)[0][:, 1, 0]
    return shift


def measure_dog(grid: Grid, discretization: Discretization) -> Tensor:
    """Amplitude in the middle of an image that is far larger than the filter."""
    dog, found = OrientedDoG((240, 240), angles=(0.0,), exact=True), []
    for k in range(len(grid["wavelength"])):
        film = gratings({name: values[k : k + 1] for name, values in grid.items()}, seconds=1, fps=1, size=(240, 240))
        found.append(amplitude(dog(film.frames(0, 1))[:, :, 0, 0, 120, 120].double()))
    return torch.cat(found)


def dog_formula(grid: Grid, discretization: Discretization) -> Tensor:
    """Spectrum of the upright filter at a grating's frequency, times its amplitude."""
    angle = torch.deg2rad(grid["direction"])
    across, down = angle.cos() / grid["wavelength"], -angle.sin() / grid["wavelength"]
    return 0.5 * grid["contrast"] * dog_spectrum(down, across, 0.0).abs()


def gains(grid: Grid, discretization: Discretization | None) -> tuple[Tensor, Tensor, Tensor]:
    """Gain of the high-pass and of the delay, complex, None for continuous filters; and the wave number along x."""
    omega = 2 * math.pi * grid["temporal_frequency"]

    def low(name: str) -> Tensor:
        tau = grid.get(name, torch.zeros_like(omega))
        if discretization is None:
            return 1 / (1 + 1j * omega * tau)
        pairs = zip(tau.tolist(), grid["fps"].tolist(), strict=True)
        a = torch.tensor([ratio(one, 1 / fps, discretization) for one, fps in pairs], dtype=torch.float64)
        return a / (1 - (1 - a) * torch.exp(-1j * omega / grid["fps"]))

    k = 2 * math.pi * torch.deg2rad(grid["direction"]).cos() / grid["wavelength"]
    return 1 - low("tau_high"), low("tau_low"), k


def both(formula: Callable[[Tensor, Tensor, Tensor, Tensor], Tensor]) -> dict[str, Callable[..., Tensor]]:
    """A formula of amplitude, gains and wave number, for discrete and for continuous filters."""
    return {
        "discrete": lambda grid, kind: formula(0.5 * grid["contrast"], *gains(grid, kind)),
        "continuous": lambda grid, _: formula(0.5 * grid["contrast"], *gains(grid, None)),
    }


MOVING = {"temporal_frequency": 3.0, "wavelength": 20.0, "direction": 0.0, "contrast": 1.0, "fps": 100.0}
PAIR = {**MOVING, "tau_high": 0.5, "tau_low": 0.05}
ROW = {**MOVING, "fps": 30.0, "tau_high": 0.005}
DETECTORS: dict[str, Detector] = {
    "hassenstein-reichardt": Detector(
        sensor(HassensteinReichardt, pair, border="reflect"),
        both(lambda a, high, late, k: (a * high.abs()) ** 2 * -late.imag * k.sin()),
        PAIR,
    ),
    "barlow-levick": Detector(sensor(BarlowLevick, pair, border="reflect"), {}, PAIR),
    "nd-min": Detector(sensor(NDMin, pixel), both(lambda a, high, late, k: a * high.abs()), ROW),
    "nd-minus": Detector(sensor(NDMinus, pixel), both(lambda a, high, late, k: a * high.abs() * (1 - k.cos())), ROW),
    "nds": Detector(
        sensor(NDS, pixel),
        both(lambda a, high, late, k: a * high.abs() * (1 + 2 * late * k.cos()).abs()),
        {**ROW, "tau_low": 0.0},
    ),
    "chahl-srinivasan": Detector(
        measure_shift,
        {"formula": lambda g, _: (TURN * g["speed"] / g["wavelength"]).sin() / (TURN / g["wavelength"]).sin()},
        {"speed": 1.0, "wavelength": 20.0, "contrast": 1.0},
    ),
    "oriented-dog": Detector(
        measure_dog, {"formula": dog_formula}, {"wavelength": 60.0, "direction": 0.0, "contrast": 1.0}
    ),
}
"""Detectors by name."""

USUAL_VALUES: dict[str, list[float]] = {
    "temporal_frequency": [round(0.25 * 2 ** (n / 3), 3) for n in range(20)],
    "wavelength": [2.5, 3, 4, 5, 6, 8, 10, 15, 20, 30, 50, 100],
    "direction": [15.0 * n for n in range(25)],
    "contrast": [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0],
    "speed": [0.1 * n for n in range(-30, 31)],
    "fps": [25, 30, 50, 60, 100, 200, 500, 1000],
    "tau_high": [0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0],
    "tau_low": [0.0, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2],
}
"""Values of the parameters that are usually shown."""
