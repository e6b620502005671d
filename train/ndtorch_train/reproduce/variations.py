"""B10 to B12 and C12: other filters, another first stage, another delay, and images of other resolutions."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import torch
import torch.nn.functional as F
from torch import Tensor

from ndtorch.binding import BindingInputs, FirstStage, InhibitoryNetwork, learning_rule
from ndtorch.report.plots import STYLES
from ndtorch.scenes import make_scene
from ndtorch.vision import FEATURES, GROUPS, VisualFeatures
from ndtorch_train.plots import BLUE, ORANGE, feature_legend, matrix_panel, panels
from ndtorch_train.reproduce.experiment import Context, Outcome
from ndtorch_train.reproduce.first_stage import orientation_inputs, settled
from ndtorch_train.reproduce.signals import PAIR, learn, owners, rendered


def filter_width(context: Context, step: float = 5.0, scales: Sequence[float] = (0.8, 1.0, 1.25)) -> Outcome:
    """A bar at rest at every orientation, through filters that are narrower or wider across."""
    curves: dict[str, list[Tensor]] = {"inputs": [], "outputs": []}
    for scale in scales:
        tilts, inputs = orientation_inputs(step, center=(19.0, 6.0 * scale), surround=(22.0, 9.0 * scale))
        for name, curve in (("inputs", inputs), ("outputs", settled("orientation", inputs).clamp_min(0))):
            curves[name].append(curve / curve.amax(0))
    figure, axes = panels("ab", 11, 4, sharey=True)
    for one, (name, several) in zip(axes, curves.items(), strict=True):
        for scale, curve, dashes in zip(scales, several, (":", "-", "--"), strict=True):
            for feature, y in zip(FEATURES[GROUPS["orientation"]], curve.T, strict=True):
                label = f"{scale:g}" if feature == "0°" else None
                one.plot(tilts, y, color=STYLES[feature].color, ls=dashes, lw=1.5, label=label)
        one.set(title=f"network {name}", xlabel="orientation of the bar (degrees)", ylabel="ratio to the largest")
    axes[1].legend(frameon=False, title="width of filters")
    caption = "Orientation tuning before and after refinement with filters of 0.8 to 1.25 times their width across."
    context.draw("B-filter-width", figure, "B discussion", caption)

    usual = scales.index(1.0)
    least = {name: [float(curve.amin(0).mean()) for curve in several] for name, several in curves.items()}
    change = {
        name: max(float((curve - several[usual]).square().mean().sqrt()) for curve in several)
        for name, several in curves.items()
    }
    criteria = {
        "refined curves change by less than .05 (RMS)": change["outputs"] < 0.05,
        "and by less than their inputs": change["outputs"] < change["inputs"],
    }
    ours = f"RMS change {change['inputs']:.3f} of inputs, {change['outputs']:.3f} of outputs"
    words = {name: ", ".join(f"{value:.2f}" for value in values) for name, values in least.items()}
    why = f"Across {scales[0]:g} to {scales[-1]:g} times as wide: min/max {words['inputs']} before, {words['outputs']} "
    return Outcome(ours, f"{why}after.", criteria, {"min/max": least})


def stages_on_a_scene(sums: Tensor, first: float, second: float) -> tuple[FirstStage, Tensor]:
    """Both stages on the sums of one scene, `[T, 10]` at 100 frames a second, at once. [B §2.3]

    Args:
        first, second: learning rates, 1/s.

    Returns:
        the first stage, its networks stopped at a spectral radius of 0.9, and the weights of the second.
    """
    (inputs, _), _ = BindingInputs()(sums)
    refined, weights = [], []
    for group in GROUPS.values():
        rule = learning_rule("competitive", gamma=first, radius_limit=0.9)
        network = InhibitoryNetwork(group.stop - group.start, rule=rule, tau_in=float("inf"), when_full="stop")
        out, state = network(inputs[:, group])
        refined.append(out)
        weights.append(state.weights)
    _, state = InhibitoryNetwork(rule=learning_rule("competitive", gamma=second))(torch.cat(refined, -1))
    motion, orientation, color = weights
    return FirstStage(motion, orientation, color, len(sums) / 100), state.weights


def both_stages(context: Context, repeats: int = 4, gamma: float = 5.0) -> Outcome:
    """The first stage trained on two bars in place of rings, then the second; and both at once."""
    sums = rendered(context, "two-bars")
    longer = sums.repeat(repeats, 1)  # the scene again and again
    with torch.inference_mode():
        stage, together = stages_on_a_scene(longer, gamma, 0.5)
    after = learn(sums, first_stage=stage).final
    usual = learn(sums).final
    cases = {"rings, then the scene": usual, "the scene, then the scene": after, "both at once": together}
    figure, axes = panels("abc", 16, 5.4)
    for one, (name, w) in zip(axes, cases.items(), strict=True):
        matrix_panel(one, w, name, simplified=True)
    feature_legend(figure)
    context.draw("B-both-stages", figure, "B §2.3", "Weights of the second stage after three ways to train the first.")
    found = {name: owners(w) for name, w in cases.items()}
    criteria = {f"red and green: {name}": found[name] == PAIR for name in list(cases)[1:]}
    largest = [float(part.max()) for part in stage[:3]]
    ours = "; ".join(f"{name}: {', '.join(names) or 'none'}" for name, names in list(found.items())[1:])
    why = f"{longer.shape[0] / 100:g} s of the scene. Largest first-stage weights {largest[0]:.2f}, {largest[1]:.2f}, "
    why += f"{largest[2]:.2f}; of rings at most 0.30, 0.55, 0.45."
    return Outcome(ours, why, criteria, {"first stage": list(stage[:3])})


def inhibition_delay(context: Context, delays: Sequence[float] = (0.01, 0.02, 0.05, 0.1, 0.2)) -> Outcome:
    """Two bars with longer and longer delays of the inhibition."""
    sums, rows = rendered(context, "two-bars"), []
    for delay in delays:
        run = learn(sums, delay=delay)
        rows.append((delay, owners(run.final), float(run.final.max()), run.model.verdict(run.state)))
    good = [delay for delay, names, *_ in rows if names == PAIR]
    largest = [row[2] for row in rows]
    figure, (one,) = panels("a", 6, 3.6)
    one.semilogx(delays, largest, ".-", color=BLUE, ms=10)
    one.set(xlabel="delay of the inhibition (s)", ylabel="largest weight", ylim=(0, None))
    context.draw("B-delay", figure, "B eq. 18", "Largest weight after 15 s of two bars against the delay tau_i.")
    criteria = {
        "red and green up to 50 ms, a twentieth of the fluctuations' period": all(
            d in good for d in delays if d <= 0.05
        ),
        "largest weight within .05 up to 20 ms": abs(largest[1] - largest[0]) <= 0.05,
    }
    ours = f"red and green at {', '.join(f'{1000 * delay:g}' for delay in good)} ms"
    words = "; ".join(f"{1000 * d:g} ms {', '.join(names)}, {w:.2f}" for d, names, w, _ in rows)
    return Outcome(ours, f"Owners and largest weight: {words}.", criteria, {"rows": rows})


def image_resolution(
    context: Context, sides: Sequence[int] = (10, 20, 50, 100, 250, 500), seconds: float = 6.0
) -> Outcome:
    """Inputs of the network from images of fewer pixels, against those of 500 x 500."""
    signals = {}
    for side in sides:
        k = 500 / side
        features = VisualFeatures((side, side), center=(19 / k, 6 / k), surround=(22 / k, 9 / k), exact=side < 500)
        state, sums = None, []
        with torch.inference_mode():
            for frames in make_scene("two-bars", seconds=seconds).chunks(20):
                out, state = features(F.adaptive_avg_pool2d(frames, side), state)
                sums.append(out)
            (inputs, _), _ = BindingInputs()(torch.cat(sums))
        signals[side] = inputs[100:]
    full = signals[500] - signals[500].mean(0)
    like = {}
    for side, inputs in signals.items():
        own = inputs - inputs.mean(0)
        both = own.norm(dim=0) * full.norm(dim=0)
        there = full.norm(dim=0) > 0.05 * full.norm(dim=0).amax()  # nothing goes up
        like[side] = float(((own * full).sum(0) / both.clamp_min(1e-12))[there].mean())
    figure, (one,) = panels("a", 6, 3.6)
    one.semilogx(list(like), list(like.values()), ".-", color=ORANGE, ms=10)
    one.set(xlabel="side of the image (pixels)", ylabel="correlation with 500 pixels", ylim=(0, 1.05))
    context.draw("C-resolution", figure, "C §5.2", "Mean correlation of the ten inputs with those of full images.")
    values = list(like.values())
    criteria = {
        "tiny images (10 pixels) under .8": like[sides[0]] < 0.8,
        "larger images never worse by .02": all(b >= a - 0.02 for a, b in itertools.pairwise(values)),
        "saturates: half the side over .98": like[sides[-2]] > 0.98,
    }
    ours = ", ".join(f"{side} px {value:.2f}" for side, value in like.items())
    return Outcome(
        ours,
        "Correlation of the ten inputs; bars are 12 pixels wide at 500.",
        criteria,
        {str(side): value for side, value in like.items()},
    )
