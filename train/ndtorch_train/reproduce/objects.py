"""C1 to C3, C8 and C9: rules, the table of objects, the enhanced image, and the limits of the model."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

import ndtorch
from ndtorch.binding import PublishedModel, object_table
from ndtorch.binding.attention import attention_mask, feature_weights
from ndtorch.scenes import two_bars
from ndtorch.vision import FEATURES, LowPass
from ndtorch_train.plots import BLUE, bare, feature_legend, matrix_panel, output_panel, panels
from ndtorch_train.reproduce.experiment import Context, Outcome
from ndtorch_train.reproduce.signals import N_GREEN, N_RED, PAIR, learn, owners, rendered, superposed


def rules(context: Context) -> Outcome:
    """The reference stimulus with both rules."""
    sums = rendered(context, "two-bars")
    both = {rule: learn(sums, rule=rule) for rule in ("competitive", "cooperative")}
    figure, axes = panels("ab;cd", 13, 10)
    for k, (rule, run) in enumerate(both.items()):
        bold = owners(run.final) if rule == "competitive" else []
        output_panel(axes[k], run.time, run.outputs, f"outputs, {rule} rule", bold)
        matrix_panel(axes[2 + k], run.final, f"weights, {rule} rule")
    feature_legend(figure)
    caption = "Two bars in sine shadow: the competitive rule beside the cooperative one."
    context.draw("C3-rules", figure, "C fig. 3", caption)
    a, b = (float(run.final[:, [N_RED, N_GREEN]].sum() / run.final.sum()) for run in both.values())
    criteria = {"competitive: at least .6 of the weight in both columns": a >= 0.6, "cooperative: at most .3": b <= 0.3}
    why = "Two of ten columns would have .20 of evenly spread weights."
    numbers = {"owners": {rule: owners(run.final) for rule, run in both.items()}}
    return Outcome(f"{a:.2f} against {b:.2f} of the weight", why, criteria, numbers)


def table(context: Context) -> Outcome:
    """The simplified weights and the matrix of objects."""
    run = learn(rendered(context, "two-bars"))
    read = object_table(run.final)
    numbers_of = (read.owners.nonzero().flatten() + 1).tolist()
    rows = read.rows[read.owners]
    figure, axes = panels("ab", 13, 5.4, width_ratios=[1, 1.15])
    matrix_panel(axes[0], run.final, "simplified weights", simplified=True)
    axes[1].imshow((rows if len(rows) else torch.zeros(1, 10)).numpy(), cmap="Blues", vmin=0, vmax=1)
    for i, j in rows.nonzero().tolist():
        ink = "w" if rows[i, j] > 0.55 else "k"
        axes[1].text(j, i, f"{rows[i, j]:.2f}", ha="center", va="center", color=ink, fontsize=9)
    axes[1].set_xticks(range(10), FEATURES, rotation=45)
    axes[1].set_yticks(range(len(numbers_of)), [f"object {k + 1}" for k in range(len(numbers_of))])
    axes[1].set(title=f"object matrix O, r = {numbers_of}")
    caption = "From the simplified weights to one row of features for every object."
    context.draw("C4-objects", figure, "C fig. 4", caption)
    return Outcome(f"r = {numbers_of}", "", {"r = [8, 9]": numbers_of == [8, 9]}, {"O": rows})


class AttendedMoment(NamedTuple):
    """What attention makes of one moment: time since learning began, winner, `[H, W, 3]` images, f_j, and how bright
    red is beside green in the input (`before`), the winner beside the other in the enhanced image (`gain`)."""

    time: float
    winner: int
    frame: Tensor
    mask: Tensor
    enhanced: Tensor
    weights: Tensor
    before: float
    gain: float


def equal_moments(seconds: float, since: float, shift: tuple[float, float]) -> list[AttendedMoment]:
    """Moments of equal input at which red or green wins, five times a second from `since` seconds of learning on.
    [C eq. 11, fig. 5]"""
    model = ndtorch.load("published")
    assert isinstance(model, PublishedModel)
    low_pass = LowPass(model.config.normalise.tau_sums, 0.2)
    state = kept = None
    found = []
    with torch.inference_mode():
        for frames in two_bars(model.settle + seconds, shift=shift).chunks(20):
            signals, state = model(frames, state)
            images = model.features.images_at(frames[-1], state.motion)
            low, kept = low_pass(images[None], kept)
            time = float(signals.time[-1]) - model.settle
            f, k = feature_weights(signals.outputs[-1], object_table(state.second.weights), signals.scale[-1])
            red, green, _ = frames[-1].amax((-1, -2)).tolist()
            if time < since or int(k) not in (N_RED, N_GREEN) or not 0.8 <= red / green <= 1.25:
                continue
            mask = attention_mask(f, images, low[0])
            enhanced = frames[-1] * mask
            # An enhanced image is shown in 8 bits, where the least step is 1/255.
            peak = enhanced.amax((-1, -2)).clamp_min(1 / 255)
            gain = float(peak[0] / peak[1] if k == N_RED else peak[1] / peak[0])
            a, b, c = (image.permute(1, 2, 0).clone() for image in (frames[-1], mask, enhanced))
            found.append(AttendedMoment(time, int(k), a, b, c, f, red / green, gain))
    return found


def enhanced_image(context: Context) -> Outcome:
    """Attention when the bars pass each other, and the ratio of winner to loser at all moments of equal input."""
    passing = equal_moments(8.0, 5.0, (250.0, -85.0))
    shown = []
    for k in (N_RED, N_GREEN):  # the moment at which the bars are nearest, not the one with the best ratio
        shown += sorted((one for one in passing if one.winner == k), key=lambda one: abs(one.time - 6.5))[:1]
    if shown:
        enhanced_figures(context, shown)
    moments = equal_moments(15.0, 6.0, (0.0, 0.0))
    ratios = [[moment.gain for moment in moments if moment.winner == k] for k in (N_RED, N_GREEN)]
    red, green = (float(np.median(gains)) if gains else float("nan") for gains in ratios)
    least = min((min(gains) for gains in ratios if gains), default=float("nan"))
    criteria = {
        "both win at moments of equal input": len(shown) == 2 and all(ratios),
        "winner at least 3 times the other at every such moment": least >= 3,
        "medians within 3 to 9": 3 <= red <= 9 and 3 <= green <= 9,
    }
    first = ", ".join(f"{FEATURES[moment.winner]} {moment.gain:.1f} at {moment.time:.1f} s" for moment in shown)
    why = f"The printed ones are two moments; ours when the bars pass each other: {first}. Least of all: {least:.1f}."
    numbers = {"ratios, red and green": ratios}
    return Outcome(f"medians {red:.1f} (red) and {green:.1f} (green)", why, criteria, numbers)


def enhanced_figures(context: Context, shown: list[AttendedMoment]) -> None:
    """The two moments, input beside enhanced image, and how an enhanced image comes about."""

    def crop(image: Tensor) -> Tensor:
        return image[170:330, 170:330].clamp(0, 1)

    figure, axes = panels("ab;cd"[: 3 * len(shown) - 1].rstrip(";"), 7, 3.6 * len(shown))
    for k, moment in enumerate(shown):
        bare(axes[2 * k], crop(moment.frame), f"input at {moment.time:.1f} s")
        title = f"enhanced: {FEATURES[moment.winner]} wins, ratio {moment.gain:.1f}"
        bare(axes[2 * k + 1], crop(moment.enhanced), title)
    caption = "160 x 160 pixels from the middle of the image as the bars pass each other; input and enhanced image."
    context.draw("C6-enhanced", figure, "C fig. 6", caption)
    moment = shown[0]
    figure, axes = panels("abcd", 14, 3.6, width_ratios=[1, 1.3, 1, 1])
    bare(axes[0], crop(moment.frame), "input")
    axes[1].bar(range(10), moment.weights / moment.weights.max(), color=BLUE)
    axes[1].set_xticks(range(10), FEATURES, rotation=45)
    axes[1].set(title="weights f", ylabel="share of the largest")
    bare(axes[2], crop(moment.mask).sqrt(), "mask (square root): sum of f |HP|")
    bare(axes[3], crop(moment.enhanced), "mask times input")
    context.draw("C5-attention", figure, "C fig. 5", "How the enhanced image is made, at the first of the two moments.")


def equal_bars(context: Context, kinds: Sequence[str] = ("shadow", "distance", "random")) -> Outcome:
    """Three bars alike in every feature that fluctuate differently."""
    found = {kind: owners(learn(rendered(context, "equal-bars", fluctuation=kind)).final) for kind in kinds}
    criteria = {f"{kind}: three objects": len(names) == 3 for kind, names in found.items()}
    ours = "; ".join(f"{kind}: {len(names)} ({', '.join(names)})" for kind, names in found.items())
    why = "Sums over the whole field add equal bars up before the network sees them: it has one mixture of three."
    return Outcome(ours, why, criteria, {"owners": found})


def scene_change(
    context: Context,
    after: float = 30.0,
    phases: Sequence[float] = (60.0, 90.0, 120.0, 240.0, 270.0, 300.0),
    offsets: Sequence[float] = (0.0, 20.0, 40.0),
) -> Outcome:
    """Red and green bars for 15 s; then the red one is gone and a blue one is there. Beside it, scenes that stay."""
    red, green, blue = superposed(context, phases, offsets, 19.0 + after)
    late = torch.arange(red.shape[-2])[:, None] >= 1900
    changed = (green[:, None] + torch.where(late, blue[None], red)).flatten(0, 1)
    run = learn(torch.cat([changed, red + green, (green[:, None] + blue[None]).flatten(0, 1)]))
    n, at = len(changed), int((run.weight_time <= 15).sum()) - 1
    before = [owners(w) for w in run.weights[:n, at]]
    end = [owners(w) for w in run.final]
    asked = [names for was, names in zip(before, end, strict=False) if was == PAIR]
    exact, gone = asked.count(["green", "blue"]), sum("red" not in names for names in asked)
    stay = end[n:-n].count(PAIR), end[-n:].count(["green", "blue"])
    criteria = {
        "the old object is forgotten in 9 of 10 trials": gone >= 0.9 * max(1, len(asked)),
        "exactly the two that are there in 9 of 10 trials": exact >= 0.9 * max(1, len(asked)),
    }
    ours = f"red forgotten in {gone}, exactly green and blue in {exact} of {len(asked)} trials"
    count = statistics.median(map(len, asked)) if asked else 0
    why = f"{after:g} s after the change the table shows {count:g} objects (median). Scenes that stay for "
    why += f"{15 + after:g} s: red and green right in {stay[0]} of {len(phases)}, green and blue in {stay[1]} of {n}."
    return Outcome(ours, why, criteria, {"owners at the end": end[:n]})
