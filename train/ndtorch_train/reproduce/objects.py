"""C1 to C3, C8 and C9: rules, the table of objects, the enhanced image, and the limits of the model."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

import ndtorch
from ndtorch.binding import PublishedModel, object_table
from ndtorch.binding.attention import attention_mask, feature_weights
from ndtorch.scenes import two_bars
from ndtorch.vision import FEATURES, LowPass
from ndtorch_train.plots import BLUE, GREEN, ORANGE, bare, feature_legend, matrix_panel, output_panel, panels
from ndtorch_train.reproduce.experiment import Context, Outcome, judged
from ndtorch_train.reproduce.signals import (
    N_BLUE,
    N_GREEN,
    N_RED,
    PAIR,
    draw_runs,
    learn,
    one_trial,
    owners,
    rendered,
    share_in,
    superposed,
)


def rules(context: Context, seconds: float) -> Outcome:
    """The reference stimulus with both rules."""
    sums = rendered(context, "two-bars", seconds=4.0 + seconds)
    both = {rule: learn(sums, rule=rule) for rule in ("competitive", "cooperative")}
    figure, axes = panels(2, 2, 13, 10)
    for k, (rule, run) in enumerate(both.items()):
        bold = owners(run.final) if rule == "competitive" else []
        output_panel(axes[k], run.time, run.outputs, f"outputs, {rule} rule", bold, None, 0.0)
        matrix_panel(axes[2 + k], run.final, f"weights, {rule} rule")
    feature_legend(figure)
    caption = "Two bars in sine shadow: the competitive rule beside the cooperative one."
    context.draw("C3-rules", figure, "C fig. 3", caption, phase=290, seconds=seconds)
    shares = {rule: share_in(run.final, (N_RED, N_GREEN)) for rule, run in both.items()}
    numbers = {"share of weight in red and green": shares, "owners": {r: owners(run.final) for r, run in both.items()}}
    parts = {
        "competitive: at least .6 of the weight in both columns": shares["competitive"] >= 0.6,
        "cooperative: at most .3": shares["cooperative"] <= 0.3,
    }
    ours = f"{shares['competitive']:.2f} against {shares['cooperative']:.2f} of the weight"
    return judged(context, ours, "Two of ten columns would have .20 of evenly spread weights.", parts, numbers)


def table(context: Context, seconds: float) -> Outcome:
    """The simplified weights and the matrix of objects."""
    run = learn(rendered(context, "two-bars", seconds=4.0 + seconds))
    read = object_table(run.final)
    numbers_of = (read.owners.nonzero().flatten() + 1).tolist()
    rows = read.rows[read.owners]
    figure, axes = panels(1, 2, 13, 5.4, width_ratios=[1, 1.15])
    matrix_panel(axes[0], run.final, "simplified weights", simplified=True)
    axes[1].imshow((rows if len(rows) else torch.zeros(1, 10)).numpy(), cmap="Blues", vmin=0, vmax=1)
    for i, j in np.ndindex(tuple(rows.shape)):
        if rows[i, j] > 0:
            ink = "w" if rows[i, j] > 0.55 else "k"
            axes[1].text(j, i, f"{rows[i, j]:.2f}", ha="center", va="center", color=ink, fontsize=9)
    axes[1].set_xticks(range(10), FEATURES, rotation=45)
    axes[1].set_yticks(range(len(numbers_of)), [f"object {k + 1}" for k in range(len(numbers_of))])
    axes[1].set(title=f"object matrix O, r = {numbers_of}")
    caption = "From the simplified weights to one row of features for every object."
    context.draw("C4-objects", figure, "C fig. 4", caption, phase=290, seconds=seconds)
    found = [obj.features for obj in run.model.objects(run.state)]
    ours = f"r = {numbers_of}"
    return judged(context, ours, "", {"r = [8, 9]": numbers_of == [8, 9]}, {"r": numbers_of, "objects": found})


class Moment(NamedTuple):
    """What attention makes of one moment: time since learning began, winner, `[H, W, 3]` images, and f_j."""

    time: float
    winner: int
    frame: Tensor
    mask: Tensor
    enhanced: Tensor
    weights: Tensor
    before: float
    after: float


def watch(seconds: float, since: float, shift: tuple[float, float]) -> list[Moment]:
    """Enhanced images five times a second, from `since` seconds of learning on. [C eq. 11, fig. 5]"""
    model = ndtorch.load("published")
    assert isinstance(model, PublishedModel)
    source = two_bars(4.0 + seconds, shift=shift)
    low_pass = LowPass(model.config.normalise.tau_sums, 0.2)
    state = kept = None
    found = []
    with torch.inference_mode():
        for frames in source.chunks(20):
            signals, state = model(frames, state)
            images = model.features.images_at(frames[-1], state.motion)
            low, kept = low_pass(images[None], kept)
            time = float(signals.time[-1]) - model.settle
            if time >= since:
                f, k = feature_weights(signals.outputs[-1], object_table(state.second.weights), signals.scale[-1])
                mask = attention_mask(f, images, low[0])
                enhanced = frames[-1] * mask
                frame = frames[-1].amax((-1, -2))
                peak = enhanced.amax((-1, -2))
                # An enhanced image is shown in 8 bits, where the least step is 1/255.
                ratio = float(peak[0].clamp_min(1 / 255) / peak[1].clamp_min(1 / 255))
                a, b, c = (image.permute(1, 2, 0).clone() for image in (frames[-1], mask, enhanced))
                found.append(Moment(time, int(k), a, b, c, f, float(frame[0] / frame[1]), ratio))
    return found


def enhanced_image(context: Context, seconds: float, crossing: tuple[float, float], medians: bool) -> Outcome:
    """Attention when the bars pass each other, and the ratio red to green over all moments of equal input."""
    passing = watch(crossing[1], crossing[0], (250.0, -85.0))

    def even(moment: Moment) -> bool:
        return 0.8 <= moment.before <= 1.25 and moment.winner in (N_RED, N_GREEN)

    def gain(moment: Moment) -> float:
        return moment.after if moment.winner == N_RED else 1 / moment.after

    shown = []
    for k in (N_RED, N_GREEN):
        of_it = [moment for moment in passing if moment.winner == k and even(moment)]
        if of_it:
            # The moment at which the bars are nearest, not the one with the best ratio.
            middle = (crossing[0] + crossing[1]) / 2
            shown.append(min(of_it, key=lambda moment: abs(moment.time - middle)))
    if shown:
        enhanced_figures(context, shown)
    moments = watch(seconds, 6.0, (0.0, 0.0)) if medians else passing
    ratios = {
        FEATURES[k]: [gain(moment) for moment in moments if moment.winner == k and even(moment)]
        for k in (N_RED, N_GREEN)
    }
    mids = {name: float(np.median(r)) if r else float("nan") for name, r in ratios.items()}
    least = min((min(r) for r in ratios.values() if r), default=float("nan"))
    numbers: dict[str, Any] = {
        "shown": [{"time": moment.time, "winner": FEATURES[moment.winner], "ratio": gain(moment)} for moment in shown],
        "median": mids,
        "least": least,
        "moments": {name: len(r) for name, r in ratios.items()},
        "ratios": ratios,
    }
    parts = {
        "both win at moments of equal input": len(shown) == 2 and all(ratios.values()),
        "winner at least 3 times the other at every such moment": bool(least >= 3),
        "medians within 3 to 9": all(3 <= m <= 9 for m in mids.values()),
    }
    ours = f"medians {mids['red']:.1f} (red) and {mids['green']:.1f} (green)"
    first = ", ".join(f"{FEATURES[moment.winner]} {gain(moment):.1f} at {moment.time:.1f} s" for moment in shown)
    why = f"The printed ones are two moments; ours when the bars pass each other: {first}. Least of all: {least:.1f}."
    return judged(context, ours, why, parts, numbers)


def enhanced_figures(context: Context, shown: list[Moment]) -> None:
    """The two moments, input beside enhanced image, and how an enhanced image comes about."""

    def crop(image: Tensor) -> Tensor:
        return image[170:330, 170:330].clamp(0, 1)

    figure, axes = panels(len(shown), 2, 7, 3.6 * len(shown))
    for k, moment in enumerate(shown):
        words = f"{FEATURES[moment.winner]} wins"
        bare(axes[2 * k], crop(moment.frame), f"input at {moment.time:.1f} s")
        bare(
            axes[2 * k + 1],
            crop(moment.enhanced),
            f"enhanced: {words}, ratio {max(moment.after, 1 / moment.after):.1f}",
        )
    caption = "160 x 160 pixels from the middle of the image as the bars pass each other; input and enhanced image."
    context.draw("C6-enhanced", figure, "C fig. 6", caption, shift=(250, -85))
    moment = shown[0]
    figure, axes = panels(1, 4, 14, 3.6, width_ratios=[1, 1.3, 1, 1])
    bare(axes[0], crop(moment.frame), "input")
    share = moment.weights / moment.weights.max()
    axes[1].bar(range(10), share, color=BLUE)
    axes[1].set_xticks(range(10), FEATURES, rotation=45)
    axes[1].set(title="weights f", ylabel="share of the largest")
    bare(axes[2], crop(moment.mask).sqrt(), "mask (square root): sum of f |HP|")
    bare(axes[3], crop(moment.enhanced), "mask times input")
    caption = "How the enhanced image is made, at the first of the two moments."
    context.draw("C5-attention", figure, "C fig. 5", caption, shift=(250, -85))


def equal_bars(context: Context, seconds: float, kinds: list[str]) -> Outcome:
    """Three bars alike in every feature that fluctuate differently."""
    found, shown = {}, []
    for kind in kinds:
        run = learn(rendered(context, "equal-bars", fluctuation=kind, seconds=4.0 + seconds))
        found[kind] = owners(run.final)
        shown.append((kind, run, found[kind], None))
    caption = "Three green bars alike in all but their fluctuation; the paper claims three objects and shows none."
    draw_runs(context, shown, "C-equal-bars", "C §5.5.2", caption, kinds=kinds, seconds=seconds)
    parts = {f"{kind}: three objects": len(names) == 3 for kind, names in found.items()}
    ours = "; ".join(f"{kind}: {len(names)} ({', '.join(names)})" for kind, names in found.items())
    why = "Sums over the whole field add equal bars up before the network sees them: it has one mixture of three."
    return judged(context, ours, why, parts, {"owners": found})


def scene_change(context: Context, before: float, after: float, phases: list[float], offsets: list[float]) -> Outcome:
    """Red and green bars; then the red one is gone and a blue one is there, at once. Beside it, scenes that stay."""
    seconds = 4.0 + before + after
    red, green, blue = superposed(context, phases, offsets, seconds)
    late = torch.arange(red.shape[-2])[:, None] >= round(100 * (4.0 + before))
    changed = (green[:, None] + torch.where(late, blue[None], red)).flatten(0, 1)
    stays = red + green
    swapped = (green[:, None] + blue[None]).flatten(0, 1)
    run = learn(torch.cat([changed, stays, swapped]))
    n = len(changed)
    at = int((run.weight_time <= before).sum()) - 1
    now = [owners(w) for w in run.final[:n]]
    was = [owners(w) == PAIR for w in run.weights[:n, at]]
    asked = [i for i, good in enumerate(was) if good]
    exact = [i for i in asked if now[i] == ["green", "blue"]]
    gone = [i for i in asked if "red" not in now[i]]
    control = [owners(w) for w in run.final[n:]]
    kept = sum(names == PAIR for names in control[: len(stays)])
    alone = sum(names == ["green", "blue"] for names in control[len(stays) :])
    columns = run.weights[:n].sum(-2)
    count = [len(now[i]) for i in asked]

    figure, axes = panels(1, 3, 15, 4.6, width_ratios=[1.3, 1, 1])
    chosen = asked[len(asked) // 2] if asked else 0
    output_panel(axes[0], run.time, run.outputs[chosen], "outputs of one trial", [], None, 0.0)
    axes[0].axvline(before, color="0.3", ls=":")
    for k, color, name in ((N_RED, ORANGE, "red"), (N_GREEN, GREEN, "green"), (N_BLUE, BLUE, "blue")):
        trace = columns[asked][:, :, k] if asked else columns[:, :, k]
        axes[1].plot(run.weight_time, trace.median(0).values, color=color, lw=2.2, label=f"from {name}")
        axes[1].fill_between(run.weight_time, trace.amin(0), trace.amax(0), color=color, alpha=0.15, lw=0)
    axes[1].axvline(before, color="0.3", ls=":")
    axes[1].set(title="sum of weights, median and range", xlabel="time since learning began (s)", ylabel="weight")
    axes[1].set_xlim(0, before + after)
    axes[1].legend(frameon=False)
    matrix_panel(axes[2], run.final[chosen], "weights at the end", simplified=True)
    feature_legend(figure)
    caption = f"At {before:g} s the red bar is gone and a blue one is there (dotted). Sums superposed from lone bars."
    context.draw(
        "C-scene-change", figure, "C §5.5.2", caption, before=before, after=after, phases=phases, offsets=offsets
    )
    several = max(1, len(asked))
    numbers = {
        "trials": n,
        "red and green before the change": len(asked),
        "red no longer an object": len(gone),
        "exactly green and blue": len(exact),
        "objects at the end, median": float(np.median(count)) if count else None,
        "owners at the end": now,
        "verdicts": [run.model.verdict(one_trial(run.state, i)) for i in asked],
        "red and green all the time, still right": [kept, len(stays)],
        "green and blue from the start, right": [alone, n],
        "share of the red column left, median": float((columns[:, -1, N_RED] / columns[:, at, N_RED])[asked].median())
        if asked
        else None,
    }
    parts = {
        "the old object is forgotten in 9 of 10 trials": len(gone) >= 0.9 * several,
        "exactly the two that are there in 9 of 10 trials": len(exact) >= 0.9 * several,
    }
    ours = f"red forgotten in {len(gone)}, exactly green and blue in {len(exact)} of {len(asked)} trials"
    why = f"{after:g} s after the change the table shows {np.median(count) if count else 0:g} objects (median)."
    why += f" Scenes that stay for {before + after:g} s: red and green right in {kept} of {len(stays)},"
    why += f" green and blue in {alone} of {n}."
    return judged(context, ours, why, parts, numbers)
