"""Constants of tracking that a config.toml holds."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from ndtorch.config import Constants

FIXED = (
    "certain unbent shadow piece follow grouped blurred room restless glimpse near shortly same_size among several "
    "stride least_stride doubt behind step swing grown beside fate moves "
    "steady shared reach alone forget lately whole leaves familiar warm_up"
)
"""Keys of version 0.2.0 that are constants in the code now, or whose rule is gone (steady)."""


class TrackingParams(Constants):
    """How blobs become tracks. A `size` is the mean of an object's height and width."""

    old_keys: ClassVar = dict.fromkeys(FIXED.split(), "") | {
        "smallest": "min_area_ratio",
        "tiny": "min_area_isolated_ratio",
        "gap": "closing_px",
        "notch": "split_notch_ratio",
        "gate": "gate_sizes",
        "unlike": "color_cost",
        "known_by": "split_color_cost",
        "alike_size": "max_area_ratio",
        "own_color": "occlusion_color_cost",
        "coast": "max_lost_s",
        "ahead": "max_prediction_s",
        "shortest": "min_track_s",
        "travel": "min_travel_sizes",
        "way": "min_travel_height_ratio",
        "wander": "clutter_travel_factor",
        "many": "clutter_rate",
        "crowded": "clutter_density",
        "clear": "min_contrast_sigma",
        "straight": "min_straightness_ratio",
        "trial": "probation_s",
        "larger": "parent_area_ratio",
        "rests": "stationary_after_s",
        "stays": "stationary_max_s",
        "doubtful": "tentative_max_s",
    }

    min_area_ratio: float = Field(
        0.0005, gt=0, description="A blob has at least this area, as a fraction of the image area."
    )
    min_area_isolated_ratio: float = Field(
        0.0002, gt=0, description="An isolated blob has at least this area, as a fraction of the image area."
    )
    closing_px: int = Field(2, ge=0, description="Gaps of up to this many pixels inside a blob are closed.")
    split_notch_ratio: float = Field(
        0.8,
        ge=0,
        le=1,
        description="A blob is cut where its height is below this fraction of the height on both sides.",
    )
    gate_sizes: float = Field(
        1.0, gt=0, description="An unmatched blob may be this many sizes from where a track is expected."
    )
    color_cost: float = Field(
        2.0, ge=0, description="A color difference of full scale costs this much, where the gate's distance costs 1."
    )
    max_area_ratio: float = Field(
        3.0, gt=1, description="The areas of two detections of a track differ by at most this ratio."
    )
    split_color_cost: float = Field(
        4.0, ge=0, description="A color difference of full scale costs this much where a group splits."
    )
    occlusion_color_cost: float = Field(
        16.0,
        ge=0,
        description="A squared color difference of full scale costs this many squared sizes in shared blobs.",
    )
    tau_velocity: float = Field(
        0.4, ge=0, description="A detection after t seconds changes the velocity by t / (this + t)."
    )
    tau_size: float = Field(
        0.4, ge=0, description="Size and color of a track follow with this time constant in seconds."
    )
    max_lost_s: float = Field(1.0, ge=0, description="A track ends after this many seconds without a detection.")
    max_prediction_s: float = Field(
        0.5, ge=0, description="A track out of sight is predicted at its velocity for this many seconds."
    )
    min_track_s: float = Field(0.3, ge=0, description="A track is confirmed after at least this many seconds.")
    min_travel_sizes: float = Field(
        0.7, ge=0, description="A track is confirmed once it has moved this many sizes; 0 confirms stationary ones too."
    )
    min_travel_height_ratio: float = Field(
        0.05, ge=0, description="A track is confirmed once it has moved this fraction of the image height."
    )
    clutter_travel_factor: float = Field(
        3.0, ge=1, description="The distances are this many times as large where tracks came and went before."
    )
    clutter_rate: float = Field(
        5.0,
        gt=0,
        description="Particles are where more tracks of one size than this begin each second and squared image height.",
    )
    clutter_density: float = Field(
        18.0, gt=0, description="Particles are also where more begin around a track, each second and squared height."
    )
    min_contrast_sigma: float = Field(
        9.0,
        gt=0,
        description="A track with this mean contrast, in deviations of the noise, need not prove rigid motion.",
    )
    min_straightness_ratio: float = Field(
        0.4, ge=0, le=1, description="A track oscillates if its net displacement is below this fraction of its path."
    )
    probation_s: float = Field(
        5.0,
        ge=0,
        description="A confirmation is revoked within this many seconds if the track only oscillates or grows.",
    )
    parent_area_ratio: float = Field(
        2.0, ge=1, description="What is in or beside something of this many times its area may be a fragment of it."
    )
    stationary_after_s: float = Field(
        1.5, ge=0, description="An object that has not moved for this many seconds is stationary."
    )
    stationary_max_s: float = Field(
        60.0, ge=0, description="A stationary object becomes background after this many seconds."
    )
    tentative_max_s: float = Field(
        1.0, ge=0, description="A track that is not confirmed becomes background after this many seconds."
    )
