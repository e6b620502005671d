"""B1 to B4: what the first stage learns, and what its inhibition does to single bars."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

import ndtorch
from ndtorch.binding import train_first_stage
from ndtorch.report.plots import STYLES
from ndtorch.scenes import hsl_color, moving_bar, static_bar
from ndtorch.vision import FEATURES, GROUPS, VisualFeatures
from ndtorch_train.plots import panels
from ndtorch_train.reproduce.experiment import Context, Outcome, judged


def settled(weights: Tensor, inputs: Tensor) -> Tensor:
    """Outputs of a fixed network once they have settled on constant inputs `[..., n]`, `(I + W)^-1 i`. [B eq. 21]"""
    eye = torch.eye(len(weights), dtype=weights.dtype)
    outputs: Tensor = torch.linalg.solve(eye + weights, inputs.unsqueeze(-1)).squeeze(-1)
    return outputs


def shipped(group: str) -> Tensor:
    """Weights of one network of the shipped first stage, float64."""
    weights = ndtorch.load("published").first_stage()
    assert weights is not None
    return weights[GROUPS[group], GROUPS[group]].double()


def weights(context: Context, gamma: float, radius: float) -> Outcome:
    """Train the three networks on the contracting rings and look at their weights."""
    seen: list[tuple[float, list[float]]] = []

    def report(seconds: float, largest: list[float]) -> None:
        seen.append((seconds, largest))

    stage = train_first_stage(gamma, radius, report=report)
    found = {"motion": stage.motion, "orientation": stage.orientation, "color": stage.color}
    figure, axes = panels(1, 4, 14, 3.6)
    for (name, w), one in zip(found.items(), axes, strict=False):
        labels = FEATURES[GROUPS[name]]
        one.imshow(w.numpy(), cmap="Blues", vmin=0, vmax=0.6)
        for n, k in torch.cartesian_prod(torch.arange(len(w)), torch.arange(len(w))).tolist():
            one.text(k, n, f"{w[n, k]:.2f}", ha="center", va="center", color="w" if w[n, k] > 0.33 else "k")
        one.set_xticks(range(len(w)), labels)
        one.set_yticks(range(len(w)), labels)
        one.set(title=f"{name}: weights learned", xlabel="FROM this neuron", ylabel="TO this neuron")
    for k, name in enumerate(found):
        axes[3].plot([s for s, _ in seen], [w[k] for _, w in seen], ["-", "--", ":"][k], lw=2, label=name)
    axes[3].legend(frameon=False)
    axes[3].set(title="largest weight during training", xlabel="time (s)", ylabel="weight")
    caption = "Weights of the three first-stage networks after training on the contracting rings."
    context.draw("B1-first-stage", figure, "B §3.1-3.3", caption, gamma=gamma, radius=radius)

    printed = {"motion": 0.30, "orientation": 0.45, "color": 0.45}
    numbers: dict[str, Any] = {"seconds": stage.seconds}
    parts, words = {}, []
    for name, w in found.items():
        off = w[~torch.eye(len(w), dtype=torch.bool)]
        low, high = float(off.min()), float(off.max())
        numbers[name] = [low, high]
        words.append(f"{low:.2f}" if high - low < 0.005 else f"{low:.2f}-{high:.2f}")
        parts[f"{name} within .02 of {printed[name]:.2f}"] = max(abs(off - printed[name])) <= 0.02
    why = (
        "At 100 x 100 pixels the orientation filters are as large as the stimulus, and its edges treat 0° differently."
        " All three stop at a radius of 0.9."
    )
    parts = {name: bool(good) for name, good in parts.items()}
    return judged(context, " / ".join(words), why, parts, numbers)


def motion_sums(directions: list[float], orientations: list[float] | None, seconds: float) -> Tensor:
    """Motion sums of bars once the detectors have settled, `[B, 4]`, over the largest of all."""
    sums = []
    features = VisualFeatures((100, 100), 0.01)
    with torch.inference_mode():
        for k, direction in enumerate(directions):
            tilt = None if orientations is None else orientations[k]
            state, last = None, []
            for frames in moving_bar(direction, tilt, seconds=seconds).chunks(25):
                out, state = features(frames, state)
                last.append(out[..., GROUPS["motion"]])
            # The mean over half a second: the shadowless bar's sums ripple with its place between the pixels.
            sums.append(torch.cat(last)[-50:].mean(0).double())
    found = torch.stack(sums)
    return found / found.max()


def half_width(angles: Tensor, response: Tensor, center: float) -> float:
    """Half the width at half the maximum of a lobe around `center`, degrees; by interpolation."""
    offset = (angles - center + 180) % 360 - 180
    order = offset.argsort()
    x, y = offset[order], response[order] / response.max()
    middle = int(x.abs().argmin())

    def edge(step: int) -> float:
        k = middle
        while 0 <= k + step < len(y) and y[k + step] >= 0.5:
            k += step
        a, b = y[k], y[k + step]
        return abs(float(x[k] + (a - 0.5) / (a - b) * (x[k + step] - x[k])))

    return (edge(-1) + edge(1)) / 2


def motion_tuning(context: Context, step: float, seconds: float) -> Outcome:
    """Directions all around, then the aperture problem: a bar that moves right at any tilt."""
    network = shipped("motion")
    directions = [step * k for k in range(round(360 / step))]
    inputs = motion_sums(directions, None, seconds)
    outputs = settled(network, inputs).clamp_min(0)
    angles = torch.tensor(directions, dtype=torch.float64)
    tilts = [-85.0 + step * k for k in range(round(170 / step) + 1)]
    slanted = motion_sums([0.0] * len(tilts), tilts, seconds)
    refined = settled(network, slanted)

    figure, (polar,) = panels(1, 1, 6, 6, subplot_kw={"projection": "polar"})
    around = torch.cat([angles, angles[:1] + 360]).deg2rad()
    for j in range(4):
        color = STYLES[FEATURES[j]].color
        for values, width, label in ((inputs, 1.0, None), (outputs, 2.8, FEATURES[j])):
            polar.plot(around, torch.cat([values[:, j], values[:1, j]]), color=color, lw=width, label=label)
    polar.set_title("direction of motion; thin: inputs, bold: outputs", fontsize=10)
    polar.legend(loc="upper left", bbox_to_anchor=(0.95, 1.08), frameon=False)
    caption = "First-stage motion refinement. Inputs (thin) and outputs (bold) against the direction of a moving bar."
    context.draw("B4-motion-tuning", figure, "B fig. 4", caption, step=step, seconds=seconds)

    figure, axes = panels(1, 2, 11, 4, sharey=True)
    for one, values, title in zip(axes, (slanted, refined), ("network inputs", "network outputs"), strict=True):
        one.axhline(0, color="0.7", lw=0.8)
        for j in range(4):
            color, dashes = STYLES[FEATURES[j]]
            one.plot(tilts, values[:, j], color=color, linestyle=dashes, lw=1.8, label=FEATURES[j])
        one.set(title=title, xlabel="orientation of a bar that moves right (degrees)", xticks=range(-90, 91, 30))
    axes[0].set_ylabel("response, share of the largest input")
    axes[0].legend(frameon=False, fontsize=9)
    caption = "First-stage motion processing of the aperture problem: a bar that always moves right, at any tilt."
    context.draw("B5-aperture", figure, "B fig. 5", caption, step=step, seconds=seconds)

    centers = {"left": 180.0, "right": 0.0, "down": 270.0, "up": 90.0}
    before, after = (
        [half_width(angles, values[:, FEATURES.index(name)], at) for name, at in centers.items()]
        for values in (inputs, outputs)
    )
    three = (slanted > 0.05).sum(1) == 3
    weakest = refined[three].topk(3, 1).values[:, 2] / slanted[three].topk(3, 1).values[:, 2]
    unwanted = [float(values[:, 2:4].clamp_min(0).sum()) for values in (slanted, refined)]
    left = float(weakest.clamp_min(0).median()) if len(weakest) else math.nan
    numbers = {
        "half width before": before,
        "half width after": after,
        "three active at": int(three.sum()),
        "weakest of three, output over input, median": left,
        "weakest of three, largest": float(weakest.max()) if len(weakest) else math.nan,
        "vertical responses, sum before and after": unwanted,
    }
    wide, narrow = sum(before) / 4, sum(after) / 4
    parts = {
        "half-widths 61 and 51 degrees within 3": abs(wide - 61) <= 3 and abs(narrow - 51) <= 3,
        "vertical responses smaller": unwanted[1] < unwanted[0],
        "weakest of three under 10 % of its input (median)": left < 0.1,
    }
    ours = f"half-width {wide:.0f} -> {narrow:.0f}°, weakest of three down to {100 * left:.0f} %"
    why = f"Vertical responses to a bar moving right fall to {unwanted[1] / unwanted[0]:.2f} of the inputs'."
    return judged(context, ours, why, parts, numbers)


def orientation_tuning(context: Context, step: float) -> Outcome:
    """A bar at rest at every orientation."""
    network = shipped("orientation")
    tilts = torch.arange(0, 180, step, dtype=torch.float64)
    features = VisualFeatures((100, 100), exact=True)
    with torch.inference_mode():
        sums = torch.stack([features(static_bar(float(t))[None])[0][0] for t in tilts])
    inputs = sums[:, GROUPS["orientation"]].double()
    inputs = inputs / inputs.max()
    outputs = settled(network, inputs)
    figure, axes = panels(1, 2, 10, 5.2, subplot_kw={"projection": "polar"})
    around = torch.cat([tilts, tilts + 180, tilts[:1]]).deg2rad()
    for one, values, title in zip(axes, (inputs, outputs), ("network inputs", "network outputs"), strict=True):
        for name, y in zip(FEATURES[GROUPS["orientation"]], values.clamp_min(0).unbind(1), strict=True):
            one.plot(around, torch.cat([y, y, y[:1]]), color=STYLES[name].color, lw=2.2, label=name)
        one.set(title=title)
    axes[1].legend(loc="upper left", bbox_to_anchor=(0.95, 1.1), frameon=False)
    caption = (
        "First-stage orientation refinement: responses to a bar at rest against its angle (0°: long axis vertical)."
    )
    context.draw("B6-orientation-tuning", figure, "B fig. 6", caption, step=step)
    before, after = ((v.amin(0) / v.amax(0)).tolist() for v in (inputs, outputs))
    low, high = min(after), max(after)
    numbers = {"min/max of inputs": before, "min/max of outputs": after}
    parts = {"inputs .57 within .03": all(abs(r - 0.57) <= 0.03 for r in before), "outputs at most .17": high <= 0.17}
    ours = f"min/max {min(before):.2f}-{max(before):.2f} -> {low:.2f}-{high:.2f}"
    return judged(context, ours, "The shapes are those of the figure: ellipses become peanuts.", parts, numbers)


def color_tuning(context: Context, saturation: float, hues: int, lights: int) -> Outcome:
    """Colors of little saturation, all hues and lightnesses."""
    network = shipped("color")
    hue = torch.linspace(0, 360, hues)
    light = torch.linspace(0, 1, lights)
    colors = hsl_color(hue[None, :], torch.tensor(saturation), light[:, None]).double()
    # Sums of a lone bar are its color times its area: one bar shows it, the rest follows.
    features, one_color = VisualFeatures((100, 100)), (0.5, 0.4, 0.6)
    with torch.inference_mode():
        seen = features(static_bar(0.0, one_color)[None])[0][0, GROUPS["color"]].double()
    area_error = float((seen / seen.sum() - torch.tensor(one_color).double() / sum(one_color)).abs().max())
    outputs = settled(network, colors)
    top = outputs.max()
    middle = settled(network, hsl_color(hue, torch.tensor(saturation), torch.tensor(0.5)).double())
    low, high = middle.amin(-1), middle.amax(-1)
    found = (high - low) / (high + low)

    figure, axes = panels(1, 3, 14, 4)
    for one, image, title in ((axes[0], colors, "input colors"), (axes[1], (outputs / top).clamp(0, 1), "outputs")):
        one.imshow(image.numpy(), origin="lower", aspect="auto", extent=(0, 360, 0, 1))
        one.set(title=title, xlabel="hue (degrees)", ylabel="lightness", xticks=range(0, 361, 60))
    inputs = hsl_color(hue, torch.tensor(saturation), torch.tensor(0.5))
    for j, name in enumerate(FEATURES[GROUPS["color"]]):
        color = STYLES[name].color
        axes[2].fill_between(hue, 0, middle[:, j] / middle.max(), color=color, alpha=0.25, lw=0)
        axes[2].plot(hue, middle[:, j] / middle.max(), color=color, lw=1, label=f"{name}, output")
        axes[2].plot(hue, inputs[:, j], color=color, lw=2.6, label="input")
    axes[2].set(title="at lightness 0.5: inputs bold", xlabel="hue (degrees)", ylabel="value", ylim=(0, 1.05))
    axes[2].set_xticks(range(0, 361, 60))
    axes[2].legend(fontsize=7.5, ncols=3, frameon=False, loc="upper center")
    caption = f"First-stage color refinement of colors of saturation {saturation:g}; outputs over the largest of all."
    context.draw("B7-color-tuning", figure, "B fig. 7", caption, saturation=saturation)
    numbers = {
        "saturation of outputs, least, mean, most": [float(found.min()), float(found.mean()), float(found.max())],
        "largest error of 'sums are color times area'": area_error,
    }
    # .6 to .8 are known to one digit.
    parts = {
        "every output saturation .6 to .8, to the digit given": bool((found >= 0.55).all() and (found < 0.85).all())
    }
    ours = f"{saturation:g} -> {float(found.min()):.2f}-{float(found.max()):.2f}"
    return judged(context, ours, "Saturation at lightness 0.5, over all hues.", parts, numbers)
