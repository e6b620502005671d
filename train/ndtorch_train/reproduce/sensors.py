"""A1 to A3: the four speed sensors, their time constants, and the angle of a pixel."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn

from ndtorch.navigation import StereoRig
from ndtorch.scenes import FrameSource, Pattern, grating
from ndtorch.scenes.patterns import Screen
from ndtorch.vision import NDS, SPEED_SCALE, ChahlSrinivasan, NDMin, NDMinus, judge_speed_curve, speed_response
from ndtorch_train.plots import BLACK, BLUE, GREEN, ORANGE, PURPLE, panels
from ndtorch_train.reproduce.experiment import Context, Outcome

MEASURED = {"NDS": (1.49, 2.71), "ND-minus": (0.77, 0.62), "ND-min": (1.00, 1.30), "Chahl-Srinivasan": (1.00, 1.21)}
"""Responses at 1 and 2 pixels a step, as an independent implementation of the paper measured them."""


def moving_rows(
    speeds: Sequence[float], phases: Sequence[float] = (0.0,), length: int = 201, width: int = 640
) -> Pattern:
    """Rows of a square grating of 10 pixels on 10, 0.25 and 0.75, at so many pixels a step from so many places of its
    first edge, `[S, P, T, 1, 1, width]`. [A Methods]"""
    screen: Screen = {"seconds": length / 30, "fps": 30.0, "size": (1, width), "channels": 1}
    rate, shift = [[30 / 20 * speed] for speed in speeds], [9.0 * width - 18.0 * phase for phase in phases]
    return grating(20.0, rate, contrast=0.5, profile="square", phase=shift, **screen)


def flickering_rows() -> Pattern:
    """That grating at rest times a sinusoid of 14.9 Hz from 0 to 1, `[T, 1, 1, 640]`. [A Methods]"""
    still = moving_rows([0.0], length=1).light

    def light(x: Tensor, y: Tensor, t: Tensor) -> Tensor:
        return (0.5 + 0.5 * torch.sin(2 * math.pi * 14.9 * t)) * still(x, y, t)[0, 0]

    return Pattern("flickering-grating", light, seconds=200 / 30, fps=30.0, size=(1, 640), channels=1)


def magnitudes(sensor: nn.Module, speeds: list[float], count: int, settle: int, width: int = 640) -> Tensor:
    """Mean response to each speed over `count` start phases within a pixel, none of them whole."""
    phases = [k / count + 0.03 for k in range(count)]
    source = moving_rows(speeds, phases, length=settle + 200, width=width)
    return speed_response(sensor, source.chunks(32), settle)[..., 0].mean(1)


def shifts(source: FrameSource) -> Tensor:
    """Mean shift that Chahl-Srinivasan sees, over time."""
    rows = torch.cat(list(source.chunks(32)), -4)
    seen: Tensor = ChahlSrinivasan()(rows)[0][..., 1:, 0].mean(-1)
    return seen


def characterisation(context: Context, step: float = 0.25) -> Outcome:
    """Speeds of -2 to 2 pixels a step, and flicker at rest."""
    speeds = [step * k for k in range(-round(2 / step), round(2 / step) + 1)]
    sensors = {"NDS": NDS(), "ND-minus": NDMinus(), "ND-min": NDMin()}
    found = {name: SPEED_SCALE * magnitudes(sensor, speeds, 8, 10) for name, sensor in sensors.items()}
    found["Chahl-Srinivasan"] = shifts(moving_rows(speeds, [k / 8 + 0.03 for k in range(8)])).mean(-1)
    flicker = {
        name: SPEED_SCALE * float(speed_response(sensor, flickering_rows().chunks(), 10)[0])
        for name, sensor in sensors.items()
    }
    least = min(flicker, key=lambda name: flicker[name])
    flicker["Chahl-Srinivasan"] = float(shifts(flickering_rows()))
    beyond = SPEED_SCALE * magnitudes(NDMin(), [2.0, 2.5, 3.0], 8, 10)

    figure, axes = panels("ab;cd", 11, 8, sharex=True)
    for one, color, (name, curve) in zip(axes, (BLUE, ORANGE, GREEN, PURPLE), found.items(), strict=True):
        signed = name == "Chahl-Srinivasan"
        one.plot(speeds, speeds if signed else list(map(abs, speeds)), color=BLACK, lw=1, ls="--", label="actual speed")
        half = len(speeds) // 2
        one.plot(speeds[:half], curve[:half], color=color, lw=2)
        one.plot(speeds[half + 1 :], curve[half + 1 :], color=color, lw=2, label=name)
        one.plot(0, flicker[name], "D", color=color, ms=7, label="flicker at rest")
        one.set(title=name + ("" if signed else " (x 20)"), ylabel="estimate (px/step)", xlabel="speed (px/step)")
        one.legend(frameon=False, fontsize=8)
        one.grid(color="0.92")
    caption = "Four sensors: response to a square grating against its speed, and to flicker of 14.9 Hz at rest."
    context.draw("A3-sensors", figure, "A fig. 3", caption)

    at = {name: [float(curve[speeds.index(v)]) for v in (1.0, 2.0)] for name, curve in found.items()}
    criteria = {
        f"{name} {a:.2f} and {b:.2f} within 3 %": max(abs(at[name][0] / a - 1), abs(at[name][1] / b - 1)) <= 0.03
        for name, (a, b) in MEASURED.items()
    }
    growth = {name: b / a for name, (a, b) in at.items()}
    criteria["NDS saturates least, ND-minus declines"] = (
        growth["NDS"] == max(growth.values()) and growth["ND-minus"] < 1
    )
    criteria["ND-min flat beyond 2"] = float((beyond / beyond[0] - 1).abs().max()) < 0.02
    criteria["ND-minus answers flicker least of the three"] = least == "ND-minus"
    ours = "; ".join(f"{name} {a:.2f}, {b:.2f}" for name, (a, b) in at.items())
    why = "At 1 and 2 px a step. Flicker: " + ", ".join(f"{name} {f:.2f}" for name, f in flicker.items()) + "."
    return Outcome(ours, why, criteria, {"at speeds": found, "flicker": flicker, "ND-min at 2, 2.5, 3": beyond})


def time_constants(
    context: Context, taus: Sequence[float] = (0, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, math.inf)
) -> Outcome:
    """Every pair of time constants of NDS, judged by range of increase first, then straightness."""
    speeds = [0.25 * k for k in range(1, 9)]

    def judged(sensor: Callable[..., nn.Module], *pair: float) -> tuple[float, float]:
        settle = max([0] + [math.ceil(5 * tau * 30) for tau in pair if math.isfinite(tau)])
        curve = judge_speed_curve(torch.tensor(speeds), magnitudes(sensor(*pair), speeds, 4, settle, 160))
        return float(curve.monotonic_to), float(curve.linearity)

    found = {pair: judged(NDS, *pair) for pair in itertools.product(taus, repeat=2)}
    high, low = max(found, key=lambda pair: found[pair])
    best = {}
    for name, sensor in (("ND-minus", NDMinus), ("ND-min", NDMin)):
        single = {tau: judged(sensor, tau) for tau in taus}
        best[name] = max(single, key=lambda tau: single[tau])
    ours = f"{1000 * high:g} ms / {1000 * low:g} ms; " + ", ".join(f"{n} {1000 * tau:g} ms" for n, tau in best.items())
    why = "High-pass / low-pass of NDS; by range of increase first, then absence of saturation, as in the paper."
    criteria = {"5 ms / 0": (high, low) == (0.005, 0.0)} | {f"{n} 5 ms": tau == 0.005 for n, tau in best.items()}
    numbers = {"reach and straightness": {str(pair): result for pair, result in found.items()}}
    return Outcome(ours, why, criteria, numbers)


def pixel_angle(context: Context) -> Outcome:
    """The best straight line through the angles of the row's pixels."""
    rig = StereoRig()
    p = rig.pixel_position(torch.arange(640, dtype=torch.float64))
    error = rig.angle(p, "linear").rad2deg() - rig.angle(p, "atan").rad2deg()
    slope, rms = math.degrees(rig.pixel_angle), float(error.square().mean().sqrt())
    criteria = {"0.1212 within .00005": abs(slope - 0.1212) <= 5e-5, "0.875 within 1 %": abs(rms / 0.875 - 1) <= 0.01}
    why = f"The line is up to {float(error.abs().max()):.1f}° off, which misplaces walls; atan is the default."
    return Outcome(f"{slope:.4f}°/px, RMS {rms:.3f}°", why, criteria, {"slope": slope, "rms": rms})
