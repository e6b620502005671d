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
from ndtorch_train.benchmark.foreground import USES, run_model
from ndtorch_train.benchmark.mot import LabelledClip, clip_folders, mot_score, read_clip
from ndtorch_train.benchmark.street_clips import STREETS, street_clip
from ndtorch_train.rows import Row

ENDLESS = 1e9
RULES: Mapping[str, Mapping[str, Any]] = {
    "none": {},
    "travel": {"min_travel_sizes": 0.0},
    "travel, shorter": {"min_travel_sizes": 0.35, "min_travel_height_ratio": 0.025},
    "rigid motion": {"min_contrast_sigma": 1e-9},
    "straightness": {"min_straightness_ratio": 0.0},
    "probation": {"probation_s": 0.0},
    "clutter map": {"clutter_travel_factor": 1.0},
    "particles": {"clutter_rate": ENDLESS, "clutter_density": ENDLESS},
    "common fate": {"parent_area_ratio": ENDLESS},
    "shadow": {"shadow_min_ratio": 1.0},
    "half shadow": {"shadow_min_ratio": 0.5},
    "closing": {"closing_px": 0},
    "notch": {"split_notch_ratio": 0.0},
    "isolated blobs": {"min_area_isolated_ratio": 0.0005},
    "color": {"color_cost": 0.0},
    "color in groups": {"occlusion_color_cost": 0.0, "split_color_cost": 0.0},
    "tentative": {"tentative_max_s": ENDLESS},
}
"""Each rule, and the constants that switch it off."""
TRACKING = "ndtorch.tracking."
CODE: Mapping[str, Mapping[str, Any]] = {
    "rigid motion of all": {
        "confirmation.is_rigid_motion": lambda *_: True,
        "tracker.update_appearance_match": lambda *_: None,
    },
    "revoked confirmation": {"confirmation.revoke_confirmation": lambda *_: False},
    "narrow shadow": {"confirmation.is_shadow": lambda *_: False},
    "cast shadow": {"blobs.cast_shadows": lambda *_: None},
    "hidden tracks": {"association.has_room": lambda *_: True},
    "splits": {"tracker.resolve_splits": lambda *_: None},
    "ghosts traced back": {"tracker.trace_back": lambda ghosts, *_: ghosts},
}
"""Rules without a constant, and what replaces names of `ndtorch.tracking`."""

COLUMNS = (
    Column("clip", "clip"),
    Column("method", "rule that is off"),
    Column("f", "F", better=1),
    Column("box_f", "F of boxes", better=1),
    Column("idf1", "IDF1", better=1),
    Column("count_error", "count error", better=-1),
    Column("mask_f", "mask F", better=1),
    Column("ms_per_frame", "ms a frame", better=-1),
)
NOTE = (
    "The model foreground with one rule off at a time; `none` is the model as it is. F of places as in the benchmark."
)


def ablation_benchmark(split: Split, folder: Path | None = None) -> Benchmark:
    """The ablation over generated street clips and those of a folder."""
    clips: dict[str, Callable[[], LabelledClip]] = {
        kind: functools.partial(street_clip, kind, split) for kind in STREETS
    }
    for place in [] if folder is None else clip_folders(folder):
        clips[place.name] = functools.partial(read_clip, place)
    tasks = [Task(clip, functools.partial(measure, clip, make)) for clip, make in clips.items()]
    settings = {"folder": str(folder), "split": split, "rules": f"{RULES} {list(CODE)}"}
    title = "What each rule earns"
    return Benchmark("ablation", title, NOTE, COLUMNS, tasks, USES, mean_rows, no_image, settings=settings)


def measure(name: str, make: Callable[[], LabelledClip], folder: Path) -> list[Row]:
    """A row for each rule on one clip."""
    labelled, rows = make(), list[Row]()
    clip = labelled.clip._replace(frames=list(labelled.clip.frames))
    labelled = replace(labelled, clip=clip)
    for rule in (*RULES, *CODE):
        with ExitStack() as off:
            for place, other in CODE.get(rule, {}).items():
                off.enter_context(patch(TRACKING + place, other))
            output = run_model("foreground", clip, 0, RULES.get(rule, {}))
        score = asdict(mot_score(output, labelled.truth(), clip.fps, labelled.masked))
        rows.append({"clip": name, "method": rule} | {column.key: score[column.key] for column in COLUMNS[2:]})
    return rows


def mean_rows(rows: list[Row]) -> list[Row]:
    """Means over all clips."""
    found = list[Row]()
    for rule in dict.fromkeys(row["method"] for row in rows):
        mine = [row for row in rows if row["method"] == rule]
        values = {c.key: [float(v) for row in mine if (v := row[c.key]) is not None] for c in COLUMNS[2:]}
        means = {key: float(np.mean(each)) if each else None for key, each in values.items()}
        found.append({"clip": "mean", "method": rule, **means})
    return found


def no_image(rows: list[Row], folder: Path) -> list[Any]:
    """A table says it all."""
    return []
