"""`ndtorch benchmark foreground --ablate`: what each rule of segmentation and tracking earns, over all clips."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from ndtorch_train.benchmark.base import Benchmark, Column, Split, Task
from ndtorch_train.benchmark.dish_clips import DISHES
from ndtorch_train.benchmark.foreground import USES, dish_in, drawn_clip, labelled_clip, negative_clip, run_model
from ndtorch_train.benchmark.mot import LabelledClip, clip_folders, mot_score
from ndtorch_train.benchmark.negative_clips import still_image
from ndtorch_train.benchmark.street_clips import STREETS
from ndtorch_train.rows import Row

ENDLESS = 1e9
RULES: Mapping[str, Mapping[str, Any]] = {
    "none": {},
    "travel": {"min_travel_sizes": 0.0},
    "travel, share of the height": {"min_travel_height_ratio": 0.0},
    "rigid motion": {"min_contrast_sigma": 1e-9},
    "probation": {"probation_s": 0.0},
    "clutter map": {"clutter_travel_factor": 1.0},
    "particles": {"clutter_rate": ENDLESS, "clutter_density": ENDLESS},
    "particles, density": {"clutter_density": ENDLESS},
    "parts of larger blobs": {"parent_area_ratio": ENDLESS},
    "shadow": {"shadow_min_ratio": 1.0},
    "closing": {"closing_px": 0},
    "notch": {"split_notch_ratio": 0.0},
    "isolated blobs": {"min_area_isolated_ratio": 0.0005},
    "color": {"color_cost": 0.0},
    "color in groups": {"occlusion_color_cost": 0.0},
    "color at splits": {"split_color_cost": 0.0},
    "area": {"max_area_ratio": ENDLESS},
    "prediction": {"max_prediction_s": 0.0},
    "tentative becomes background": {"tentative_max_s": ENDLESS},
    "stationary becomes background": {"stationary_max_s": ENDLESS},
    "learning under objects": {"object_learning_ratio": 0.0},
}
"""Each rule, and the constants that switch it off."""
CODE: Mapping[str, Mapping[str, Any]] = {
    "rigid motion of all": {
        "tracking.confirmation.is_rigid_motion": lambda *_: True,
        "tracking.tracker.update_appearance_match": lambda *_: None,
    },
    "revoked confirmation": {"tracking.confirmation.revoke_confirmation": lambda *_: False},
    "revoked, only grew": {"tracking.rigid_motion.MIN_GROWTH_SIZES": 0.0},
    "revoked, oscillates": {"tracking.rigid_motion.MIN_NET_TRAVEL_RATIO": 0.0},
    "growth restarts travel": {"tracking.tracker.EDGE": ENDLESS},
    "fragments restart travel": {"tracking.tracker.is_small": lambda *_: False},
    "narrow shadow of a track": {"tracking.confirmation.is_shadow": lambda *_: False},
    "narrow shadow beside an object": {"tracking.blobs.cast_shadows": lambda *_: None},
    "dark coat": {"foreground.segmentation.SHADOW_CLOSING_RATIO": 0.0},
    "swinging": {"foreground.swinging.MIN_AREA_RATIO": ENDLESS},
    "broad motion": {"foreground.segmentation.MOTION_TRAIL_S": -1.0},
    "fragments dropped": {"tracking.blobs.drop_fragments": lambda blobs, *_: blobs},
    "ghosts": {"tracking.blobs.ghosts": lambda *_: None},
    "ghosts traced back": {"tracking.tracker.trace_back": lambda ghosts, *_: ghosts},
    "ghosts where nothing passed": {"tracking.ghosts.CLEAR_S": 0.0},
    "hidden tracks": {"tracking.association.has_room": lambda *_: True},
    "young tracks are parts": {"tracking.association.MIN_AGE_S": 0.0},
    "contained blobs are parts": {"tracking.association.MIN_CONTAINMENT": ENDLESS},
    "gate grows": {"tracking.association.GATE_GROWTH_PER_S": 0.0},
    "joint assignment": {"tracking.tracker.assign_unmatched": lambda *_: None},
    "parts of objects are objects": {"tracking.tracker.split_from": lambda *_: None},
    "splits": {"tracking.tracker.resolve_splits": lambda *_: None},
    "places in groups": {"tracking.tracker.OCCLUSION_GAIN": 1.0},
    "clutter beside objects": {"tracking.clutter.is_near": lambda *_: False},
}
"""Rules without a constant, and what replaces names of `ndtorch`."""
CLUTTER = ("leaves", "snow", "water", "screen")
"""Kinds of clips without objects."""
DISH_OPTIONS = {"max_height_px": 448, "min_area_ratio": 1e-4, "min_area_isolated_ratio": 1e-4, "probation_s": 0.0}
"""Of small animals in a dish."""

COLUMNS = (
    Column("clip", "clip"),
    Column("method", "rule that is off"),
    Column("f", "F", better=1),
    Column("box_f", "F of boxes", better=1),
    Column("idf1", "IDF1", better=1),
    Column("count_error", "count error", better=-1),
    Column("mask_f", "mask F", better=1),
    Column("false_per_minute", "false a minute", better=-1),
    Column("ms_per_frame", "ms a frame", better=-1),
)
NOTE = (
    "The model foreground with one rule off at a time; `none` is the model as it is. F of places as in the benchmark."
)


def ablation_benchmark(
    split: Split, folder: Path | None = None, negative: tuple[Path, float] | None = None
) -> Benchmark:
    """The ablation over generated street clips and dishes, clips of a folder, and clutter over a still image."""
    places = [] if folder is None else clip_folders(folder)
    clips: dict[str, Callable[[Path], LabelledClip]] = {
        place.name: functools.partial(labelled_clip, place) for place in places
    }
    clips |= {kind: functools.partial(drawn_clip, kind, split) for kind in STREETS}
    if negative is not None:
        still = still_image(negative[0])
        clips |= {kind: functools.partial(negative_clip, kind, still, negative[1], split) for kind in CLUTTER}
    clips |= {kind: functools.partial(dish_in, kind, split) for kind in DISHES}
    tasks = [
        Task(f"{clip}, {rule}", functools.partial(measure, clip, make, rule))
        for clip, make in clips.items()
        for rule in (*RULES, *CODE)
    ]
    settings = {"folder": str(folder), "split": split, "rules": f"{RULES} {list(CODE)}", "negative": str(negative)}
    title = "What each rule earns"
    return Benchmark("ablation", title, NOTE, COLUMNS, tasks, USES, mean_rows, no_image, settings=settings)


KEPT: dict[str, LabelledClip] = {}
"""The latest clip with its frames, which the next rule gets too."""


def measure(name: str, make: Callable[[Path], LabelledClip], rule: str, folder: Path) -> list[Row]:
    """The row of one rule on one clip."""
    if name not in KEPT:
        KEPT.clear()
        read = make(folder)
        KEPT[name] = replace(read, clip=read.clip._replace(frames=list(read.clip.frames)))
    labelled, base = KEPT[name], DISH_OPTIONS if name in DISHES else {}
    with ExitStack() as off:
        for place, other in CODE.get(rule, {}).items():
            off.enter_context(patch(f"ndtorch.{place}", other))
        output = run_model("foreground", labelled.clip, 0, {**base, **RULES.get(rule, {})})
    score = asdict(mot_score(output, labelled.truth(), labelled.clip.fps, labelled.masked))
    return [{"clip": name, "method": rule} | {column.key: score[column.key] for column in COLUMNS[2:]}]


def mean_rows(rows: list[Row]) -> list[Row]:
    """Means over all clips with objects, the largest loss of F without each rule, and where it is; false objects."""
    whole, found = {row["clip"]: row for row in rows if row["method"] == "none"}, list[Row]()
    with_objects = {clip for clip, row in whole.items() if clip not in CLUTTER}
    for rule in dict.fromkeys(row["method"] for row in rows):
        mine = [row for row in rows if row["method"] == rule]
        places = [row for row in mine if row["clip"] in with_objects]
        values = {c.key: [float(v) for row in places if (v := row[c.key]) is not None] for c in COLUMNS[2:]}
        means = {key: float(np.mean(each)) if each else None for key, each in values.items()}
        loss, where = max((whole[row["clip"]]["f"] - row["f"], row["clip"]) for row in places)
        false = [row["false_per_minute"] for row in mine if row["clip"] in CLUTTER]
        means["false_per_minute"] = float(np.mean(false)) if false else None
        found.append({"clip": f"mean; -{loss:.3f} {where}", "method": rule, **means})
    return found


def no_image(rows: list[Row], folder: Path) -> list[Any]:
    """A table says it all."""
    return []
