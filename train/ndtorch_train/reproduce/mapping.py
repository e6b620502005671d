"""A6 to A8: rows, features, beams and maps of simulated hallways."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from ndtorch.navigation import FeatureParams, Ranges, StereoRig
from ndtorch.navigation.mapping.certainty import beam, certainty
from ndtorch.navigation.stereo.features import Features, PredictedFeatures, find_features
from ndtorch.vision import NDMin
from ndtorch_robot.evaluation.plots import draw_cells, draw_plan
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_train.plots import BLUE, GREEN, ORANGE, PURPLE, panels
from ndtorch_train.recorded import RATE, Recorded, map_of, quality, ranges_of, score_of
from ndtorch_train.reproduce.driving import recorded
from ndtorch_train.reproduce.experiment import Context, Outcome, judged

TOP_THREE = ("#d55e00", "#009e73", "#0072b2")
"""Red, green and blue of the paper's marks, in color-blind safe tones."""


def hops(features: Features) -> float:
    """Share of steps on which a slot's feature moves by more than 10 pixels: it is on another edge then."""
    column, good = features.column.double(), features.valid
    both = good[:, 1:] & good[:, :-1]
    return float(((column[:, 1:] - column[:, :-1]).abs() > 10)[both].double().mean())


def rows_and_beams(context: Context, arena: str, seed: int, seconds: float, begin: float) -> Outcome:
    """Rows over time, their ND-min outputs, features, predicted features and ranges; and the two beams."""
    seen = recorded(context, arena, seed, seconds)
    rows = torch.from_numpy(seen.rows).float() / 255
    with torch.inference_mode():
        cameras = rows.transpose(0, 1)
        outputs = NDMin()(cameras[:, :, None, None, :])[0].squeeze(-2).squeeze(-2)
        motion = outputs.transpose(0, 1)
        three = FeatureParams(count=3)
        plain = find_features(cameras, outputs, three)
        predicted, _ = PredictedFeatures(three)(cameras, outputs)
    ranges = ranges_of(seen, FeatureParams())
    space_time(context, seen, rows)
    marked(context, seen, plain, "ch2-9-features", "chapter 2 fig. 9", "the three strongest")
    marked(
        context, seen, predicted, "ch2-10-predicted", "chapter 2 fig. 10", "three features, each followed by prediction"
    )
    diagram(context, seen, rows, motion, ranges, begin)
    far, near, peak = beams(context, seen.rig)
    numbers: dict[str, Any] = {
        "hops of plain features": hops(plain),
        "hops of predicted features": hops(predicted),
        "ranges a frame": float(ranges.valid.double().sum(-1).mean()),
        "product of beams: half-length beyond and before its peak, m": [far, near],
        "peak, m": peak,
        "outputs below T_min": float((motion.abs() < 0.01).double().mean()),
        "outputs below 1 % of the largest": float((motion.abs() < 0.01 * motion.abs().max()).double().mean()),
    }
    parts = {
        "predicted features hop less": numbers["hops of predicted features"] < numbers["hops of plain features"],
        "the product of beams is longer beyond than before the feature": far > near,
        "most outputs are about zero (9 of 10 below 1 % of the largest)": numbers["outputs below 1 % of the largest"]
        >= 0.9,
    }
    ours = (
        f"hops {100 * hops(plain):.0f} % -> {100 * hops(predicted):.0f} %; beam {near:.2f} m before, {far:.2f} beyond"
    )
    why = f"{100 * numbers['outputs below 1 % of the largest']:.0f} % of the outputs are below 1 % of the largest, "
    why += f"{100 * numbers['outputs below T_min']:.0f} % below T_min = 0.01."
    return judged(context, ours, why, parts, numbers)


def space_time(context: Context, seen: Recorded, rows: Tensor) -> None:
    """Both rows over time, time upward."""
    figure, axes = panels(1, 2, 12, 7.5, sharey=True)
    end = len(rows) / RATE
    for k, (one, name) in enumerate(zip(axes, ("left camera", "right camera"), strict=True)):
        one.imshow(
            rows[:, k].numpy(), cmap="gray", origin="lower", aspect="auto", extent=(0, 640, 0, end), vmin=0, vmax=1
        )
        one.set(title=name, xlabel="column (px)")
    axes[0].set_ylabel("time (s)")
    words = f"{end:.0f} s of the center rows of both cameras along the {seen.arena}."
    context.draw("ch2-8-rows", figure, "chapter 2 fig. 8", words, arena=seen.arena, seed=seen.seed)


def marked(context: Context, seen: Recorded, features: Features, name: str, title: str, words: str) -> None:
    """Places of three features over time."""
    figure, axes = panels(1, 2, 12, 7.5, sharey=True)
    t = np.arange(len(seen.rows)) / RATE
    for k, one in enumerate(axes):
        for slot in range(3):
            good = features.valid[k, :, slot].numpy()
            place = features.column[k, :, slot].numpy()[good]
            order = ("first", "second", "third")[slot]
            one.scatter(place, t[good], s=3, color=TOP_THREE[slot], lw=0, label=order, rasterized=True)
        one.set(title=("left camera", "right camera")[k], xlabel="column (px)", xlim=(0, 640), ylim=(0, t[-1]))
    axes[0].set_ylabel("time (s)")
    axes[1].legend(markerscale=4, frameon=True, loc="upper right", fontsize=9)
    context.draw(name, figure, title, f"Motion features over time: {words}.", arena=seen.arena, seed=seen.seed)


def diagram(context: Context, seen: Recorded, rows: Tensor, motion: Tensor, ranges: Ranges, begin: float) -> None:
    """200 frames from the images to the ranges."""
    first = min(round(begin * RATE), max(0, len(rows) - 200))
    part = slice(first, first + 200)
    figure, axes = panels(4, 2, 11, 15)
    extent = (0.0, 640.0, first / RATE, (first + 200) / RATE)
    options: dict[str, Any] = {"origin": "lower", "aspect": "auto", "extent": extent}
    angles = (np.tan(ranges.left_angle.numpy()), np.tan(ranges.right_angle.numpy()))
    t = np.broadcast_to((np.arange(len(rows)) / RATE)[:, None], ranges.valid.shape)
    with torch.inference_mode():
        found = find_features(rows.transpose(0, 1), motion.transpose(0, 1), FeatureParams())
    scatter = None
    for k, camera in enumerate(("left", "right")):
        axes[k].imshow(rows[part, k].numpy(), cmap="gray", vmin=0, vmax=1, **options)
        axes[k].set_title(f"image row, {camera}")
        highest = float(motion[part].abs().quantile(0.999))
        axes[2 + k].imshow(motion[part, k].abs().numpy(), cmap="magma", vmin=0, vmax=highest, **options)
        axes[2 + k].set_title(f"|ND-min|, {camera}")
        good = found.valid[k, part].numpy()
        place = found.column[k, part].numpy()[good]
        axes[4 + k].scatter(place, t[part][good], s=3, color=BLUE, lw=0, rasterized=True)
        axes[4 + k].set_title(f"5 features, {camera}")
        matched = ranges.valid[part].numpy()
        column = 319.5 - seen.rig.focal * angles[k][part]
        scatter = axes[6 + k].scatter(
            column[matched], t[part][matched], s=6, c=ranges.left_range[part].numpy()[matched], cmap="viridis",
            vmin=0.65, vmax=2.3, lw=0, rasterized=True)  # fmt: skip
        axes[6 + k].set_title(f"matched features, {camera}")
    for k, one in enumerate(axes):
        one.set(xlim=(0, 640), ylim=extent[2:])
        if k % 2 == 0:
            one.set_ylabel("time (s)")
        if k >= 6:
            one.set_xlabel("column (px)")
    assert scatter is not None
    figure.colorbar(scatter, ax=axes[6:], label="range (m)", shrink=0.8)
    words = "From image rows to ranges: rows, outputs of ND-min, features, and those matched between both cameras."
    context.draw(
        "A10-ranging", figure, "A fig. 10", words, arena=seen.arena, seed=seen.seed, frames=[first, first + 200]
    )


def beams(context: Context, rig: StereoRig) -> tuple[float, float, float]:
    """The beams of both cameras, their sum and their product; half-lengths of the product and its peak."""
    from dataclasses import replace

    rig = replace(rig, forward=0.0)
    x, y = torch.tensor([1.5]).double(), torch.tensor([0.1]).double()
    half = rig.baseline / 2
    left, right = torch.atan2(y - half, x), torch.atan2(y + half, x)
    seen = Ranges(torch.hypot(x, y - half), left, right, x, y, torch.tensor([True]))
    # Shown ten times as wide as they are: at their width of a pixel nothing can be seen.
    wide = 10 * rig.pixel_angle
    gx, gy = torch.meshgrid(torch.linspace(0.01, 2.6, 520), torch.linspace(-0.6, 0.6, 360), indexing="xy")
    a = beam(gx, gy - half, left, wide, 3.0)
    b = beam(gx, gy + half, right, wide, 3.0)
    figure, axes = panels(1, 2, 13, 4)
    for one, image, title in ((axes[0], a + b, "sum of the two beams"), (axes[1], a * b, "product of the two beams")):
        shown = one.imshow(image.numpy(), origin="lower", extent=(0.01, 2.6, -0.6, 0.6), cmap="magma", aspect="equal")
        one.plot([0, 0], [half, -half], "o", color=GREEN, ms=6, clip_on=False)
        one.plot(float(x), float(y), "+", color="#56b4e9", ms=12, mew=2)
        one.set(title=title, xlabel="x, ahead (m)", ylabel="y, to the left (m)")
        figure.colorbar(shown, ax=one, shrink=0.8, label="certainty")
    words = "Certainty of a feature at the cross, seen by two cameras (dots); beams drawn ten times as wide as a pixel."
    context.draw("A11-beams", figure, "A fig. 11", words, feature=[1.5, 0.1], reach=3.0, spread="10 pixels")
    along = torch.linspace(0.8, 3.0, 4401).double()
    values = certainty(along, along * float(y / x), seen, rig)
    top = int(values.argmax())
    inside = along[values >= values.max() / 2]
    return float(inside[-1] - along[top]), float(along[top] - inside[0]), float(along[top])


def hallway_map(context: Context, seeds: list[int], seconds: float, noisy: bool) -> Outcome:
    """One pass of the hallway with exact and with noisy odometry."""
    drives: dict[str, list[Recorded]] = {"true": [], "noisy": []}
    tasks = [(s, o) for o in drives for s in seeds if o == "true" or noisy]
    for seed, odometry in tasks:
        drives[odometry].append(recorded(context, "hallway", seed, seconds, odometry=odometry))
    seen = drives["true"][0]
    figure, (one,) = panels(1, 1, 14, 3.6)
    draw_plan(one, load_arena(seen.arena, seen.seed), faint=True)
    draw_cells(one, seen.cells.astype(np.float64), seen.grid, 2)
    one.plot(*seen.line().T, color=BLUE, lw=1, label="path")
    one.plot([0.5, 1.5, 1.5, 0.5, 0.5], [-0.5, -0.5, 0.5, 0.5, -0.5], color=PURPLE, lw=1.5, label="one square metre")
    figure.legend(*one.get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    words = "Map (red) of one pass of the simulated hallway, over its true plan; doors brown."
    context.draw("A12-map", figure, "A fig. 12", words, seed=seen.seed, seconds=seconds, odometry="true")

    arenas(context, seen.seed)

    def median(odometry: str, key: str) -> float | None:
        values = [d.summary["map"][key] for d in drives[odometry] if d.summary["map"][key] is not None]
        return float(np.median(values)) if values else None

    keys = ("spacing_error_percent", "position_error_cm", "recall", "precision")
    numbers: dict[str, Any] = {o: {key: median(o, key) for key in keys} for o in drives if drives[o]}
    numbers["each"] = {f"{o} {d.seed}": d.summary["map"] for o in drives for d in drives[o]}
    spacing, place = numbers["true"]["spacing_error_percent"], numbers["true"]["position_error_cm"]
    parts = {
        "door spacing within 1.2 % (median, exact odometry)": spacing is not None and spacing <= 1.2,
        "edges within 1.6 cm (median, exact odometry)": place is not None and place <= 1.6,
    }
    ours = (
        f"spacing error {spacing:.1f} %, edges {place:.1f} cm" if spacing is not None and place is not None else "none"
    )
    why = f"Median of {len(seeds)} hallways; {100 * (numbers['true']['recall'] or 0):.0f} % of the visible edges found."
    if noisy:
        n = numbers["noisy"]
        parts["door spacing within 1.2 % with 1 % scale error and drift"] = (n["spacing_error_percent"] or 99) <= 1.2
        why += f" With noisy odometry {n['spacing_error_percent'] or float('nan'):.1f} % and "
        why += f"{n['position_error_cm'] or float('nan'):.1f} cm."
    return judged(context, ours, why, parts, numbers)


def arenas(context: Context, seed: int) -> None:
    """The buildings from above."""
    from ndtorch_robot.sim.arenas import BUILDINGS

    figure, axes = panels(2, 3, 14, 8.5)
    for one, name in zip(axes, BUILDINGS, strict=True):
        draw_plan(one, load_arena(name, seed))
        one.set_title(name)
    words = "The simulated buildings from above, doors brown; the paper's hallway is in (a) with its door spacing."
    context.draw("A9-arenas", figure, "A fig. 9", words, seed=seed)


def feature_count(context: Context, seeds: list[int], seconds: float, counts: list[int]) -> Outcome:
    """Maps of the same drives with 1 to 12 features a frame."""
    found = np.full((len(seeds), len(counts), 3), np.nan)
    for i, seed in enumerate(seeds):
        seen = recorded(context, "hallway", seed, seconds)
        for j, count in enumerate(counts):
            score = score_of(seen, map_of(seen, ranges_of(seen, FeatureParams(count)), 3.0))
            found[i, j] = score["precision"] or 0, score["recall"] or 0, quality(score)
    mean = found.mean(0)
    figure, (one,) = panels(1, 1, 8, 4.4)
    for k, (name, color, style) in enumerate(
        (("precision", BLUE, "--"), ("recall", ORANGE, ":"), ("both", GREEN, "-"))
    ):
        one.plot(counts, mean[:, k], style, color=color, lw=2.4, marker="o", ms=4, label=name)
        one.fill_between(counts, found[..., k].min(0), found[..., k].max(0), color=color, alpha=0.12, lw=0)
    one.axvspan(3, 7, color="0.93", zorder=0)
    one.set(xlabel="features a frame", ylabel="share", ylim=(0, 1), title="hallway maps, mean and range of the seeds")
    one.legend(frameon=False, title="both: harmonic mean")
    words = "Precision, recall and their harmonic mean of hallway maps against the number of features (grey: 3 to 7)."
    context.draw("A-feature-count", figure, "A Methods", words, seeds=seeds, counts=counts, seconds=seconds)
    best = counts[int(mean[:, 2].argmax())]
    inside = [m for c, m in zip(counts, mean[:, 2], strict=True) if 3 <= c <= 7]
    parts = {
        "the best number lies in 3 to 7": 3 <= best <= 7,
        "3 to 7 all within 10 % of the best": min(inside) >= 0.9 * mean[:, 2].max(),
    }
    numbers = {"counts": counts, "mean precision, recall, both": mean, "best": best}
    ours = f"best at {best}; {min(inside):.2f}-{max(inside):.2f} at 3 to 7 (harmonic mean of precision and recall)"
    return judged(context, ours, "Chapter 2 gives 3 to 12 of the same system.", parts, numbers)
