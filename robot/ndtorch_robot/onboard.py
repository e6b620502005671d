"""Constants of the published step for a microcontroller: `python -m ndtorch_robot.onboard [CONFIG] > params.h`.

`robot/firmware/onboard` holds the step in C99, without allocation. All that it knows of a robot is in `params.h`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from ndtorch.navigation.controllers.published import PublishedControl
from ndtorch.navigation.mapping.certainty import BEYOND_SIGHT, REACH, beam_table
from ndtorch.navigation.stereo.ranging import StereoRanging
from ndtorch.navigation.stereo.rig import StereoRig
from ndtorch.vision.nondirectional import SPEED_SCALE
from ndtorch_robot.run_config import read_run_config

FARTHEST = 2.2
"""Range at which the places of a beam lie half a cell apart, m, as in `GridMap`."""


def onboard_params(rig: StereoRig, dt: float, cell: float = 0.05) -> str:
    """The text of `params.h`: the published controller and ranging of [A] for one pair of cameras.

    `dt` is the time step, s, and `cell` the side of a cell of the map, m.

    >>> from ndtorch.navigation import StereoRig
    >>> "#define ROW_COLUMNS 640" in onboard_params(StereoRig(), 1 / 30)
    True
    """
    control, ranging = PublishedControl(rig, dt), StereoRanging(rig, dt)
    saccade, steps, row = control.params, control.rule, ranging.numbers[0]
    left, right = control.fields
    tangents, weights = (part.double().numpy() for part in beam_table(rig, FARTHEST, cell / 2))
    # The places are a grid of those along and those across the beams, listed row by row: the first row ends where the
    # places across begin again.
    one, other = tangents
    columns = int(np.argmax(np.diff(one + other) < 0)) + 1
    across, along = (one + other)[:columns] / 2, (other - one)[::columns] / 2
    weights = weights.reshape(-1, columns) / cell**2
    middle = weights[len(along) // 2, columns // 2]
    values: dict[str, int | float] = {
        "ROW_COLUMNS": rig.width,
        "HORIZON_ROW": rig.row,
        "PATCH_ROWS": left.bottom - left.top,
        "PATCH_COLUMNS": left.right - left.left,
        "PATCH_TOP": left.top,
        "LEFT_PATCH_LEFT": left.left,
        "RIGHT_PATCH_LEFT": right.left,
        "FEATURES": ranging.features.count,
        "SPACING": ranging.features.spacing_px,
        "TURN_STEPS": int(steps.turn),
        "WATCHING_STEPS": int(steps.watching),
        "START_AGE_STEPS": int(steps.age),
        "EXACT_ANGLES": int(row["exact"]),
        "TIME_STEP": dt,
        "HIGH_PASS_SHARE": float(row["a"]),
        "SPEED_SCALE": SPEED_SCALE,
        "SMOOTHING_SHARE": steps.share,
        "TURN_THRESHOLD": saccade.turn_threshold,
        "HIGH_THRESHOLD": saccade.high_threshold,
        "LOW_THRESHOLD": saccade.low_threshold,
        "NORMAL_CURVATURE": 1 / saccade.turn_radius_m,
        "TIGHT_CURVATURE": 1 / saccade.tight_radius_m,
        "CRUISE_SPEED": saccade.speed_m_per_s,
        "MIN_MOTION": ranging.features.min_motion,
        "MIN_DIFFERENCE": ranging.features.min_difference,
        "MIN_DISPARITY": ranging.matching.min_disparity_px,
        "MAX_DISPARITY": ranging.matching.max_disparity_px,
        "AXIS_COLUMN": float(row["axis"]),
        "ANGLE_FACTOR": float(row["factor"]),
        "BASELINE": rig.baseline,
        "CAMERA_FORWARD": rig.forward,
        "BEAM_REACH": REACH,
        "FARTHEST_CROSSING": BEYOND_SIGHT,
        "MAP_CELL": cell,
    }
    tables = {
        "beam_along": along,
        "beam_along_weight": weights[:, columns // 2],
        "beam_across": across,
        "beam_across_weight": weights[len(along) // 2] / middle,
    }
    lines = ["/* Written by ndtorch_robot.onboard. m, s, radians; columns and rows of the frame in pixels. */"]
    lines += ["#ifndef PARAMS_H", "#define PARAMS_H", ""]
    lines += [f"#define {name} {v if isinstance(v, int) else f'({v!r}f)'}" for name, v in values.items()]
    lines += ["#ifndef ONBOARD_AVOIDANCE_ONLY"]
    for name, table in tables.items():
        lines.append(f"static const float {name}[] = {{{', '.join(f'{value:.9e}f' for value in table)}}};")
    return "\n".join([*lines, "#endif", "", "#endif", ""])


if __name__ == "__main__":
    config = read_run_config(Path(sys.argv[1] if len(sys.argv) > 1 else "maxstone8"))
    sys.stdout.write(onboard_params(config.stereo_rig, 1 / config.rate_hz))
