"""A1 to A3: the four speed sensors, their time constants, and the angle of a pixel."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor, nn

from ndtorch.navigation import StereoRig
from ndtorch.scenes import FlickeringGrating, MovingGrating
from ndtorch.vision import NDS, SPEED_SCALE, ChahlSrinivasan, NDMin, NDMinus, judge_speed_curve, speed_response
from ndtorch_train.plots import BLACK, BLUE, GREEN, ORANGE, PURPLE, panels
from ndtorch_train.reproduce.experiment import Context, Outcome, judged

MEASURED = {"NDS": (1.49, 2.71), "ND-minus": (0.77, 0.62), "ND-min": (1.00, 1.30), "Chahl-Srinivasan": (1.00, 1.21)}
"""Responses at 1 and 2 pixels a step, as an independent implementation of the paper measured them."""


def sub_pixel(count: int) -> list[float]:
    """Start phases within a pixel, none of them whole."""
    return [k / count + 0.03 for k in range(count)]


def magnitudes(sensor: nn.Module, speeds: list[float], phases: list[float], settle: int, width: int = 640) -> Tensor:
    """Mean response to each speed over the start phases, raw."""
    source = MovingGrating(speeds, phases, length=settle + 200, width=width)
    return speed_response(sensor, source.chunks(32), settle)[..., 0].mean(1)


def shifts(source: MovingGrating | FlickeringGrating) -> Tensor:
    """Mean shift that Chahl-Srinivasan sees, over time."""
    rows = torch.cat(list(source.chunks(32)), -4)
    seen: Tensor = ChahlSrinivasan()(rows)[0][..., 1:, 0].mean(-1)
    return seen


def characterisation(context: Context, step: float, phases: int) -> Outcome:
    """Speeds of -2 to 2 pixels a step, and flicker at rest."""
    speeds = [step * k for k in range(-round(2 / step), round(2 / step) + 1)]
    starts = sub_pixel(phases)
    found: dict[str, Tensor] = {}
    for name, sensor in (("NDS", NDS()), ("ND-minus", NDMinus()), ("ND-min", NDMin())):
        found[name] = SPEED_SCALE * magnitudes(sensor, speeds, starts, 10)
    found["Chahl-Srinivasan"] = shifts(MovingGrating(speeds, starts)).mean(-1)
    flicker = {
        name: SPEED_SCALE * float(speed_response(sensor, FlickeringGrating(length=200).chunks(), 10)[0])
        for name, sensor in (("NDS", NDS()), ("ND-minus", NDMinus()), ("ND-min", NDMin()))
    }
    flicker["Chahl-Srinivasan"] = float(shifts(FlickeringGrating(length=200)))
    beyond = SPEED_SCALE * magnitudes(NDMin(), [2.0, 2.5, 3.0], starts, 10)

    figure, axes = panels(2, 2, 11, 8, sharex=True)
    colors = dict(zip(found, (BLUE, ORANGE, GREEN, PURPLE), strict=True))
    for one, (name, curve) in zip(axes, found.items(), strict=True):
        ideal = [abs(s) for s in speeds] if name != "Chahl-Srinivasan" else speeds
        one.plot(speeds, ideal, color=BLACK, lw=1, ls="--", label="actual speed")
        moving = [k for k, s in enumerate(speeds) if s != 0]
        left = [k for k in moving if speeds[k] < 0]
        right = [k for k in moving if speeds[k] > 0]
        for part in (left, right):
            one.plot([speeds[k] for k in part], curve[part], color=colors[name], lw=2)
        one.plot([], [], color=colors[name], lw=2, label=name)
        one.plot(0, flicker[name], "D", color=colors[name], ms=7, label="flicker at rest")
        one.set(title=name + (" (x 20)" if name != "Chahl-Srinivasan" else ""), ylabel="estimate (px/step)")
        one.legend(frameon=False, fontsize=8)
        one.grid(color="0.92")
    for one in axes[2:]:
        one.set_xlabel("speed of the grating (px/step)")
    caption = "Four sensors: response to a square grating against its speed, and to flicker of 14.9 Hz at rest."
    context.draw("A3-sensors", figure, "A fig. 3", caption, speeds=[-2, 2, step], phases=phases, frames=200)

    at = {name: (float(curve[speeds.index(1.0)]), float(curve[speeds.index(2.0)])) for name, curve in found.items()}
    parts = {
        f"{name} {want[0]:.2f} and {want[1]:.2f} within 3 %": all(
            abs(a / w - 1) <= 0.03 for a, w in zip(at[name], want, strict=True)
        )
        for name, want in MEASURED.items()
    }
    growth = {name: a[1] / a[0] for name, a in at.items()}
    parts["NDS saturates least, ND-minus declines"] = growth["NDS"] == max(growth.values()) and growth["ND-minus"] < 1
    parts["ND-min flat beyond 2"] = float((beyond / beyond[0] - 1).abs().max()) < 0.02
    parts["ND-minus answers flicker least of the three"] = flicker["ND-minus"] == min(
        flicker[k] for k in ("NDS", "ND-minus", "ND-min")
    )
    ours = "; ".join(f"{name} {a[0]:.2f}, {a[1]:.2f}" for name, a in at.items())
    why = "At 1 and 2 px a step. Flicker: " + ", ".join(f"{name} {f:.2f}" for name, f in flicker.items()) + "."
    return judged(context, ours, why, parts, {"at 1 and 2": at, "flicker": flicker, "ND-min at 2, 2.5, 3": beyond})


def time_constants(context: Context, taus: list[float | str], phases: int) -> Outcome:
    """Every pair of time constants of NDS, judged by range of increase first, then straightness."""
    values = [float(tau) for tau in taus]
    speeds = [0.25 * k for k in range(1, 9)]
    starts = sub_pixel(phases)
    straight = torch.zeros(len(values), len(values))
    reach = torch.zeros_like(straight)
    for i, high in enumerate(values):
        for j, low in enumerate(values):
            settle = max([0] + [math.ceil(5 * tau * 30) for tau in (high, low) if math.isfinite(tau)])
            response = magnitudes(NDS(high, low), speeds, starts, settle, 160)
            curve = judge_speed_curve(torch.tensor(speeds), response)
            reach[i, j], straight[i, j] = float(curve.monotonic_to), float(curve.linearity)
    order = sorted(
        (float(reach[i, j]), float(straight[i, j]), i, j) for i in range(len(values)) for j in range(len(values))
    )
    _, _, i, j = order[-1]
    names = [f"{tau * 1000:g}" for tau in values]
    figure, axes = panels(1, 2, 12, 5)
    for one, data, title in ((axes[0], reach, "increases up to (px/step)"), (axes[1], straight, "straightness, 0..1")):
        shown = one.imshow(data.numpy(), cmap="Blues", vmin=0, origin="lower")
        one.plot(j, i, "o", mfc="none", mec=ORANGE, mew=2.5, ms=14)
        one.set_xticks(range(len(names)), names, rotation=45)
        one.set_yticks(range(len(names)), names)
        one.set(title=title, xlabel="low-pass time constant (ms)", ylabel="high-pass time constant (ms)")
        figure.colorbar(shown, ax=one, shrink=0.8)
    caption = "Time constants of NDS: how far its response rises with speed, and how straight. Circle: the best."
    context.draw("A-time-constants", figure, "A Methods", caption, taus=names, phases=phases)
    best = (values[i], values[j])
    ours = f"{1000 * best[0]:g} ms / {1000 * best[1]:g} ms"
    numbers: dict[str, Any] = {"reach": reach, "straightness": straight, "taus": names}
    why = "High-pass / low-pass of NDS; by range of increase first, then absence of saturation, as in the paper."
    return judged(context, ours, why, {"5 ms / 0": best == (0.005, 0.0)}, numbers)


def pixel_angle(context: Context) -> Outcome:
    """The best straight line through the angles of the row's pixels."""
    rig = StereoRig()
    p = rig.pixel_position(torch.arange(640, dtype=torch.float64))
    exact, line = (rig.angle(p, model).rad2deg() for model in ("atan", "linear"))
    slope = math.degrees(rig.pixel_angle)
    error = float((line - exact).square().mean().sqrt())
    figure, axes = panels(1, 2, 11, 4)
    axes[0].plot(p, exact, color=BLUE, lw=2, label="atan(p / f)")
    axes[0].plot(p, line, color=ORANGE, lw=2, ls="--", label=f"{slope:.4f}° p")
    axes[0].set(title="angle of a pixel", xlabel="pixels from the center", ylabel="angle (degrees)")
    axes[0].legend(frameon=False)
    axes[1].plot(p, line - exact, color=ORANGE, lw=2)
    axes[1].axhline(0, color="0.6", lw=0.8)
    axes[1].set(title="error of the line", xlabel="pixels from the center", ylabel="error (degrees)")
    caption = "The exact angle of a pixel and its least-squares line."
    context.draw("A-pixel-angle", figure, "A eq. A.3-A.4", caption, focal=430, width=640)
    parts = {"0.1212 within .00005": abs(slope - 0.1212) <= 5e-5, "0.875 within 1 %": abs(error / 0.875 - 1) <= 0.01}
    why = f"The line is up to {float((line - exact).abs().max()):.1f}° off, which misplaces walls; atan is the default."
    return judged(context, f"{slope:.4f}°/px, RMS {error:.3f}°", why, parts, {"slope": slope, "rms": error})
