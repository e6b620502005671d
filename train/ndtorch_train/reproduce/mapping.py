"""A6 to A8, A10, A11: rows, features, beams and maps of simulated hallways, objects that move, and the way back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from ndtorch.navigation import FeatureParams, Ranges, StereoRig
from ndtorch.navigation.mapping.certainty import beam, certainty
from ndtorch.navigation.stereo.features import Features, PredictedFeatures, find_features
from ndtorch.vision import DirectionalND, NDMin
from ndtorch_robot.evaluation.plots import draw_cells, draw_plan
from ndtorch_robot.sim.arenas import BUILDINGS, load_arena
from ndtorch_robot.sim.simulation import Simulation
from ndtorch_train.plots import BLUE, GREEN, PURPLE, SKY, panels
from ndtorch_train.recorded import RATE, map_of, quality, ranges_of, score_of
from ndtorch_train.reproduce.driving import recorded
from ndtorch_train.reproduce.experiment import Context, Outcome

TOP_THREE = ("#d55e00", "#009e73", "#0072b2")
"""Red, green and blue of the paper's marks, in color-blind safe tones."""


def hops(features: Features) -> float:
    """Share of steps on which a slot's feature moves by more than 10 pixels: it is on another edge then."""
    column, good = features.column.double(), features.valid
    both = good[:, 1:] & good[:, :-1]
    return float(((column[:, 1:] - column[:, :-1]).abs() > 10)[both].double().mean())


def rows_and_beams(context: Context, seconds: float = 36.0) -> Outcome:
    """Rows over time, their ND-min outputs, features, predicted features and ranges; and the two beams."""
    seen = recorded(context, "hallway", 0, seconds)
    cameras = torch.from_numpy(seen.rows).float().transpose(0, 1) / 255
    with torch.inference_mode():
        motion = NDMin()(cameras[:, :, None, None, :])[0].squeeze(-2).squeeze(-2)
        three = FeatureParams(count=3)
        plain, (predicted, _) = find_features(cameras, motion, three), PredictedFeatures(three)(cameras, motion)
    t = np.arange(len(seen.rows)) / RATE

    figure, axes = panels("ab", 12, 7.5, sharey=True)
    for one, rows, name in zip(axes, cameras, ("left camera", "right camera"), strict=True):
        one.imshow(rows.numpy(), cmap="gray", origin="lower", aspect="auto", extent=(0, 640, 0, t[-1]), vmin=0, vmax=1)
        one.set(title=name, xlabel="column (px)", ylabel="time (s)")
    words = f"{t[-1]:.0f} s of the center rows of both cameras along the hallway."
    context.draw("ch2-8-rows", figure, "chapter 2 fig. 8", words)
    marked(context, plain, t, "ch2-9-features", "chapter 2 fig. 9", "the three strongest")
    marked(context, predicted, t, "ch2-10-predicted", "chapter 2 fig. 10", "three features, followed by prediction")
    ranges = ranges_of(seen, FeatureParams())
    diagram(context, cameras, motion, ranges, t, seen.rig)
    before, beyond = beams(context, seen.rig)

    largest, sizes = float(motion.abs().max()), motion.abs()
    quiet, small = float((sizes < 0.01 * largest).double().mean()), float((sizes < 0.01).double().mean())
    criteria = {
        "predicted features hop less": hops(predicted) < hops(plain),
        "the product of beams is longer beyond than before the feature": beyond > before,
        "most outputs are about zero (9 of 10 below 1 % of the largest)": quiet >= 0.9,
    }
    ours = f"hops {100 * hops(plain):.0f} % -> {100 * hops(predicted):.0f} %; "
    ours += f"beam {before:.2f} m before, {beyond:.2f} beyond"
    why = f"{100 * quiet:.0f} % of the outputs are below 1 % of the largest, {100 * small:.0f} % below T_min = 0.01."
    numbers = {"ranges a frame": float(ranges.valid.double().sum(-1).mean())}
    return Outcome(ours, why, criteria, numbers)


def marked(context: Context, features: Features, t: Any, name: str, title: str, words: str) -> None:
    """Places of three features over time."""
    figure, axes = panels("ab", 12, 7.5, sharey=True)
    for k, one in enumerate(axes):
        for slot, order in enumerate(("first", "second", "third")):
            good = features.valid[k, :, slot].numpy()
            place = features.column[k, :, slot].numpy()[good]
            one.scatter(place, t[good], s=3, color=TOP_THREE[slot], lw=0, label=order, rasterized=True)
        one.set(title=("left camera", "right camera")[k], xlabel="column (px)", xlim=(0, 640), ylim=(0, t[-1]))
    axes[0].set_ylabel("time (s)")
    axes[1].legend(markerscale=4, frameon=True, loc="upper right", fontsize=9)
    context.draw(name, figure, title, f"Motion features over time: {words}.")


def diagram(context: Context, rows: Tensor, motion: Tensor, ranges: Ranges, t: Any, rig: StereoRig) -> None:
    """200 frames, from 8 s on, from the images to the ranges."""
    part = slice(240, 440)
    figure, axes = panels("ab;cd;ef;gh", 11, 15)
    options: Any = {"origin": "lower", "aspect": "auto", "extent": (0.0, 640.0, t[part][0], t[part][-1])}
    times = np.broadcast_to(t[part, None], ranges.valid[part].shape)
    with torch.inference_mode():
        found = find_features(rows, motion, FeatureParams())
    for k, (camera, angle) in enumerate((("left", ranges.left_angle), ("right", ranges.right_angle))):
        axes[k].imshow(rows[k, part].numpy(), cmap="gray", vmin=0, vmax=1, **options)
        size = motion[k, part].abs()
        axes[2 + k].imshow(size.numpy(), cmap="magma", vmin=0, vmax=float(size.quantile(0.999)), **options)
        good, matched = found.valid[k, part].numpy(), ranges.valid[part].numpy()
        axes[4 + k].scatter(found.column[k, part][good], times[good], s=3, color=BLUE, lw=0, rasterized=True)
        column = (319.5 - rig.focal * angle[part].tan()).numpy()[matched]
        color = ranges.left_range[part].numpy()[matched]
        scatter = axes[6 + k].scatter(column, times[matched], 6, color, vmin=0.65, vmax=2.3, lw=0, rasterized=True)
        for one, what in zip(axes[k::2], ("image row", "|ND-min|", "5 features", "matched features"), strict=True):
            one.set(title=f"{what}, {camera}", xlim=(0, 640), ylim=options["extent"][2:], ylabel="time (s)")
    figure.colorbar(scatter, ax=axes[6:], label="range (m)", shrink=0.8)
    words = "From image rows to ranges: rows, outputs of ND-min, features, and those matched between both cameras."
    context.draw("A10-ranging", figure, "A fig. 10", words)


def beams(context: Context, rig: StereoRig) -> tuple[float, float]:
    """The beams of both cameras, their sum and product; half-lengths of the product before and beyond its peak."""
    rig = replace(rig, forward=0.0)
    x, y = torch.tensor([1.5]).double(), torch.tensor([0.1]).double()
    half = rig.baseline / 2
    left, right = torch.atan2(y - half, x), torch.atan2(y + half, x)
    seen = Ranges(torch.hypot(x, y - half), left, right, x, y, torch.tensor([True]))
    # Shown ten times as wide as they are: at their width of a pixel nothing can be seen.
    wide = 10 * rig.pixel_angle
    gx, gy = torch.meshgrid(torch.linspace(0.01, 2.6, 520), torch.linspace(-0.6, 0.6, 360), indexing="xy")
    a, b = beam(gx, gy - half, left, wide, 3.0), beam(gx, gy + half, right, wide, 3.0)
    figure, axes = panels("ab", 13, 4)
    for one, image, title in zip(axes, (a + b, a * b), ("sum of the beams", "product of the beams"), strict=True):
        shown = one.imshow(image.numpy(), origin="lower", extent=(0.01, 2.6, -0.6, 0.6), cmap="magma", aspect="equal")
        one.plot([0, 0], [half, -half], "o", color=GREEN, ms=6, clip_on=False)
        one.plot(float(x), float(y), "+", color=SKY, ms=12, mew=2)
        one.set(title=title, xlabel="x, ahead (m)", ylabel="y, to the left (m)")
        figure.colorbar(shown, ax=one, shrink=0.8, label="certainty")
    words = "Certainty of a feature at the cross, seen by two cameras (dots); beams drawn ten times as wide as a pixel."
    context.draw("A11-beams", figure, "A fig. 11", words)
    along = torch.linspace(0.8, 3.0, 4401).double()
    values = certainty(along, along * float(y / x), seen, rig)
    peak, inside = along[int(values.argmax())], along[values >= values.max() / 2]
    return float(peak - inside[0]), float(inside[-1] - peak)


def hallway_map(context: Context, seeds: int = 5, seconds: float = 36.0) -> Outcome:
    """One pass of the hallway with exact and with noisy odometry."""
    drives = {
        odometry: [recorded(context, "hallway", seed, seconds, odometry=odometry) for seed in range(seeds)]
        for odometry in ("true", "noisy")
    }
    seen = drives["true"][0]
    figure, (one,) = panels("a", 14, 3.6)
    draw_plan(one, load_arena(seen.arena, seen.seed), faint=True)
    draw_cells(one, seen.cells.astype(np.float64), seen.grid, 2)
    one.plot(*seen.line().T, color=BLUE, lw=1, label="path")
    one.plot([0.5, 1.5, 1.5, 0.5, 0.5], [-0.5, -0.5, 0.5, 0.5, -0.5], color=PURPLE, lw=1.5, label="one square metre")
    figure.legend(*one.get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    words = "Map (red) of one pass of the simulated hallway, over its true plan; doors brown."
    context.draw("A12-map", figure, "A fig. 12", words)
    figure, axes = panels("abc;de.", 14, 8.5)
    for one, name in zip(axes, BUILDINGS, strict=True):
        draw_plan(one, load_arena(name, seen.seed))
        one.set_title(name)
    words = "The simulated buildings from above, doors brown; the paper's hallway is in (a) with its door spacing."
    context.draw("A9-arenas", figure, "A fig. 9", words)

    def median(odometry: str, key: str) -> float:
        values = [d.summary["map"][key] for d in drives[odometry] if d.summary["map"][key] is not None]
        return float(np.median(values)) if values else float("nan")

    spacing, place = median("true", "spacing_error_percent"), median("true", "position_error_cm")
    noisy = median("noisy", "spacing_error_percent")
    criteria = {
        "door spacing within 1.2 % (median, exact odometry)": spacing <= 1.2,
        "edges within 1.6 cm (median, exact odometry)": place <= 1.6,
        "door spacing within 1.2 % with 1 % scale error and drift": noisy <= 1.2,
    }
    why = f"Median of {seeds} hallways; {100 * median('true', 'recall'):.0f} % of the visible edges found. With noisy "
    why += f"odometry {noisy:.1f} % and {median('noisy', 'position_error_cm'):.1f} cm."
    numbers = {f"{name}, seed {d.seed}": d.summary["map"] for name, several in drives.items() for d in several}
    return Outcome(f"spacing error {spacing:.1f} %, edges {place:.1f} cm", why, criteria, numbers)


def direction_ratios(rows: Tensor, cell: int, speed: float, every: int) -> tuple[float, float]:
    """Ratios of fields in the right half whose direction is right: on an object with cells of so many pixels that moves
    against the flow, and around it."""
    texture = (torch.rand(200, generator=torch.Generator().manual_seed(0)) > 0.5).float().repeat_interleave(cell)
    times, place = torch.arange(len(rows)), 560 - (speed * torch.arange(len(rows))) % 160  # again and again
    inside = torch.arange(640.0) - place[:, None]
    first = inside.floor().long().clamp(0, 58)
    shown = torch.lerp(texture[first], texture[first + 1], (inside - first).clamp(0, 1))  # anti-aliased
    there = (inside >= 0) & (inside < 60)
    film = torch.where(there, 0.1 + 0.8 * shown, rows)[:, None, None]
    out, there = DirectionalND(every)(film)[0][:, 0, 0], there[times[::every]]
    found = []
    for kind, sign in ((there, -1), (~there, 1)):
        weight = (kind[:, 1:] & kind[:, :-1])[:, 339:].float()
        fields = max(1, round(10 / every)), 20  # a third of a second, columns
        sums, share = (F.avg_pool2d(x[None], fields)[0] for x in (out[:, 339:] * weight, weight))
        strong = (share > 0.8) & (sums.abs() > 1e-6)
        found.append(float((sign * sums[strong] > 0).float().mean()))
    return found[0], found[1]


def moving_object(context: Context, seconds: float = 36.0) -> Outcome:
    """An object that moves against the flow in the rows of a drive, found by its direction alone."""
    rows = torch.from_numpy(recorded(context, "hallway", 0, seconds).rows[:, 0]).float() / 255
    coarse, fine = (
        {every: direction_ratios(rows, cell, speed, every) for every in (1, 3, 6)}
        for cell, speed in ((12, 1.0), (4, 2.0))
    )
    figure, (one,) = panels("a", 6, 3.6)
    for name, ratios in (("12 px, 1 px a frame", coarse), ("4 px, 2 px a frame", fine)):
        one.plot(list(ratios), [100 * of for of, _ in ratios.values()], ".-", ms=10, label=f"object, {name}")
    one.plot(list(coarse), [100 * around for _, around in coarse.values()], ".--", ms=10, label="surroundings")
    one.set(xlabel="frames from one correlation to the next", ylabel="direction right (%)", ylim=(0, 103))
    one.legend(frameon=False, fontsize=8)
    context.draw(
        "A-directional", figure, "A §3", "Fields of 20 columns with the right direction against the frame rate."
    )
    criteria = {
        "object of 12 px cells against the flow in 90 %, at a third of the rate": coarse[3][0] >= 0.9,
        "that of 4 px cells too": fine[3][0] >= 0.9,
        "surroundings with the flow in 90 %, at a third of the rate": coarse[3][1] >= 0.9,
    }
    ours = "; ".join(
        f"every {k}: {100 * coarse[k][0]:.0f}, {100 * fine[k][0]:.0f}, surroundings {100 * coarse[k][1]:.0f} %"
        for k in coarse
    )
    why = "An object of 60 px is drawn into a drive. Cells finer than twice the shift between correlations alias."
    return Outcome(ours, why, criteria, {"coarse": list(coarse.values()), "fine": list(fine.values())})


def second_pass(context: Context, seeds: int = 3, seconds: float = 36.0) -> Outcome:
    """The hallway driven once, and once more back, with the cameras turned around."""
    found: dict[str, list[dict[str, float | None]]] = {"one pass": [], "there and back": []}
    figure, axes = panels("a;b", 14, 6.4, sharex=True)
    for seed in range(seeds):
        seen = recorded(context, "hallway", seed, seconds)
        cameras = Simulation(load_arena("hallway", seed), seed).cameras
        back = seen.pose[: len(seen.rows)][::-1] + np.array([0, 0, np.pi])
        look = [[side[1][0].float().mean(0)[0] for side in cameras.look(*pose)] for pose in back.tolist()]
        rows = np.stack([np.stack([row.round().byte().numpy() for row in pair]) for pair in look])
        returned = seen._replace(
            rows=np.concatenate([seen.rows, rows]),
            pose=np.concatenate([seen.pose[: len(rows)], back]),
            believed=np.concatenate([seen.believed[: len(rows)], back]),
        )
        for one, name, drive in zip(axes, found, (seen, returned), strict=True):
            cells = map_of(drive, ranges_of(drive, FeatureParams()), 3.0)
            found[name].append(score_of(drive, cells))
            if seed == 0:
                draw_plan(one, load_arena("hallway", seed), faint=True)
                draw_cells(one, cells.numpy().astype(np.float64), drive.grid, 2)
                one.set(title=name)
    context.draw("A-second-pass", figure, "A §3", "Maps (red) of one pass of the hallway, and of a second one back.")
    error, good = (
        {name: float(np.median([of(score) for score in several])) for name, several in found.items()}
        for of in (lambda score: score["position_error_cm"] or np.nan, quality)
    )
    criteria = {
        "position error under .8 of one pass": error["there and back"] < 0.8 * error["one pass"],
        "precision and recall no worse": good["there and back"] >= good["one pass"],
    }
    ours = f"edges {error['one pass']:.2f} -> {error['there and back']:.2f} cm"
    why = (
        f"Median of {seeds} hallways, exact odometry; harmonic mean of precision and recall {good['one pass']:.2f} -> "
    )
    why += f"{good['there and back']:.2f}. More edges are found; their error is that of a cell of 1 cm already."
    return Outcome(ours, why, criteria, found)


def feature_count(
    context: Context, seeds: int = 3, seconds: float = 36.0, counts: Sequence[int] = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12)
) -> Outcome:
    """Maps of the same drives with 1 to 12 features a frame."""
    mean = np.zeros(len(counts))
    for seed in range(seeds):
        seen = recorded(context, "hallway", seed, seconds)
        for j, count in enumerate(counts):
            mean[j] += quality(score_of(seen, map_of(seen, ranges_of(seen, FeatureParams(count)), 3.0))) / seeds
    best = counts[int(mean.argmax())]
    inside = [m for count, m in zip(counts, mean, strict=True) if 3 <= count <= 7]
    criteria = {
        "the best number lies in 3 to 7": 3 <= best <= 7,
        "3 to 7 all within 10 % of the best": min(inside) >= 0.9 * mean.max(),
    }
    ours = f"best at {best}; {min(inside):.2f}-{max(inside):.2f} at 3 to 7 (harmonic mean of precision and recall)"
    numbers = {"counts": counts, "harmonic mean of precision and recall": mean}
    return Outcome(ours, "Chapter 2 gives 3 to 12 of the same system.", criteria, numbers)
