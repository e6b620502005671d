"""Constants of tracking that a config.toml holds."""

from __future__ import annotations

from ndtorch.config import Constants, constant


class TrackingParams(Constants):
    """How blobs become tracks. A `size` is the mean of an object's height and width."""

    min_area_ratio: float = constant(0.0005, "A blob has at least this area, as a fraction of the image area.", gt=0)
    min_area_isolated_ratio: float = constant(
        0.0002, "An isolated blob has at least this area, as a fraction of the image area.", gt=0
    )
    closing_px: int = constant(2, "Gaps of up to this many pixels inside a blob are closed.", ge=0)
    split_notch_ratio: float = constant(
        0.8, "A blob is cut where its height is below this fraction of the height on both sides.", ge=0, le=1
    )
    gate_sizes: float = constant(1.0, "An unmatched blob may be this many sizes from where a track is expected.", gt=0)
    color_cost: float = constant(
        2.0, "A color difference of full scale costs this much, where the gate's distance costs 1.", ge=0
    )
    max_area_ratio: float = constant(3.0, "The areas of two detections of a track differ by at most this ratio.", gt=1)
    split_color_cost: float = constant(
        4.0, "A color difference of full scale costs this much where a group splits.", ge=0
    )
    occlusion_color_cost: float = constant(
        16.0, "A squared color difference of full scale costs this many squared sizes in shared blobs.", ge=0
    )
    tau_velocity: float = constant(0.4, "A detection after t seconds changes the velocity by t / (this + t).", ge=0)
    tau_size: float = constant(0.4, "Size and color of a track follow with this time constant in seconds.", ge=0)
    max_lost_s: float = constant(1.0, "A track ends after this many seconds without a detection.", ge=0)
    max_prediction_s: float = constant(
        0.5, "A track out of sight is predicted at its velocity for this many seconds.", ge=0
    )
    min_track_s: float = constant(0.3, "A track is confirmed after at least this many seconds.", ge=0)
    min_travel_sizes: float = constant(
        0.7, "A track is confirmed once it has moved this many sizes; 0 confirms stationary ones too.", ge=0
    )
    min_travel_height_ratio: float = constant(
        0.05, "A track is confirmed once it has moved this fraction of the image height.", ge=0
    )
    clutter_travel_factor: float = constant(
        3.0, "The distances are this many times as large where tracks came and went before.", ge=1
    )
    clutter_rate: float = constant(
        5.0, "Particles are where more tracks of one size than this begin each second and squared image height.", gt=0
    )
    clutter_density: float = constant(
        18.0, "Particles are also where more begin around a track, each second and squared height.", gt=0
    )
    min_contrast_sigma: float = constant(
        9.0, "A track with this mean contrast, in deviations of the noise, need not prove rigid motion.", gt=0
    )
    probation_s: float = constant(
        5.0, "A confirmation is revoked within this many seconds if the track only oscillates or grows.", ge=0
    )
    parent_area_ratio: float = constant(
        2.0, "What is in or beside something of this many times its area may be a fragment of it.", ge=1
    )
    stationary_after_s: float = constant(1.5, "An object that has not moved for this many seconds is stationary.", ge=0)
    stationary_max_s: float = constant(600.0, "A stationary object becomes background after this many seconds.", ge=0)
    tentative_max_s: float = constant(
        1.0, "A track that is not confirmed becomes background after this many seconds.", ge=0
    )
