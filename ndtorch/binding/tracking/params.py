"""Constants of detections, tracks and windows."""

from __future__ import annotations

from pydantic import Field

from ndtorch.config import Constants


class TrackParams(Constants):
    """How motion in fields becomes detections, and detections tracks. Lengths in heights of the picture, times in
    seconds, likeness as a cosine."""

    tau_motion: float = Field(0.1, ge=0, description="motion is averaged over this long")
    warm_up: float = Field(0.3, ge=0, description="the first moments, when nothing is known of background and noise")
    tau_strongest: float = Field(20.0, gt=0, description="memory of the strongest motion")
    faint: float = Field(0.01, ge=0, description="smallest strength (root of opponent motion) of a field that moves")
    noisy: float = Field(0.5, ge=0, description="the same, in units of the noise")
    relative: float = Field(0.1, ge=0, description="the same, as a share of the strongest field lately")
    saddle: float = Field(0.6, ge=0, description="peaks are one where the strength between stays above this share,")
    filled: float = Field(0.5, ge=0, description="or something stands out in this share of a field between them,")
    same_color: float = Field(0.8, ge=-1, le=1, description="and the outputs of their colors are this alike,")
    same_way: float = Field(0.7, ge=-1, le=1, description="and their directions of motion")
    gate: float = Field(0.25, gt=0, description="how far from where a track is expected a detection may be,")
    reach: float = Field(0.3, ge=0, description="and how much further a second later,")
    widest: float = Field(1.0, ge=0, description="after which it grows no more")
    unlike: float = Field(0.5, ge=0, description="cost of nothing in common, where a gate's distance costs 1")
    turn: float = Field(0.8, ge=0, description="cost of moving the other way")
    tau_velocity: float = Field(0.4, ge=0, description="a detection after t changes the velocity by t / (this + t)")
    coast: float = Field(1.2, ge=0, description="how long a track out of sight is waited for")
    shortest: float = Field(0.4, ge=0, description="smallest time in sight of an object")
    travel: float = Field(0.15, ge=0, description="smallest way gone")
    straight: float = Field(0.6, ge=0, description="smallest agreement of its directions, 0 to 1")
    ends: float = Field(0.2, gt=0, le=0.5, description="share of its path at each end, over which places are averaged")
    alike: float = Field(
        0.8, ge=-1, le=1, description="likeness of colors from which on two tracks may be of parts of one object"
    )
    along: float = Field(0.7, ge=-1, le=1, description="and likeness of their ways")
    together: float = Field(0.3, ge=0, description="share of common times of tracks side by side")
    beside: float = Field(0.25, ge=0, description="parts of one object stay this near to each other")
    behind: float = Field(2.0, ge=0, description="an object may be hidden this long,")
    comes_back: float = Field(0.5, ge=0, description="and comes back this near to where it was heading,")
    steady: float = Field(0.3, gt=0, description="with a speed taken over at least this long")
    smallest: float = Field(1 / 3, ge=0, description="share of its group's largest that makes a feature")


class WindowParams(Constants):
    """Constants of `Windows`; lengths in fields (spacings of the grid), times in seconds."""

    most: int = Field(8, gt=0, le=1000, description="objects at a time")
    period: float = Field(0.05, gt=0, description="time between updates")
    tau_low: float = Field(0.05, gt=0, description="low-pass on the signals")
    window: float = Field(0.96, gt=0, description="standard deviation of a window's receptive field, fields")
    crowd: float = Field(0.05, gt=0, description="keeps a window's share from being decided by its far ends")
    visible: float = Field(0.03, gt=0, description="an object is seen above this share of the recent largest motion")
    birth: float = Field(0.06, gt=0, description="share of it above which unclaimed motion opens a window")
    contrast: float = Field(3.0, gt=0, description="and this many times the median over all fields")
    claim: float = Field(1.66, gt=0, description="radius within which a window claims all motion, fields")
    tau_peak: float = Field(10.0, gt=0, description="memory of the recent largest motion")
    gain: float = Field(0.5, gt=0, description="alpha of the alpha-beta filter that follows the object")
    drift: float = Field(0.15, gt=0, description="beta of it")
    young: float = Field(1.0, gt=0, description="age up to which a window follows faster:")
    young_gain: float = Field(0.6, gt=0, description="with at least this alpha")
    young_drift: float = Field(0.3, gt=0, description="and at least this beta")
    updates: float = Field(4.0, gt=0, description="updates over which a residual comes about")
    reach: float = Field(0.8, gt=0, description="largest residual, fields")
    fastest: float = Field(8.0, gt=0, description="speed limit, fields a second")
    aim: float = Field(0.3, gt=0, description="age at which a window begins to prefer motion in its own direction,")
    aimed: float = Field(0.5, gt=0, description="and time until it does so fully")
    slow: float = Field(0.0625, gt=0, description="share of the speed limit below which it has no direction")
    confirm: float = Field(0.8, gt=0, description="age at which a window counts as an object")
    blind: float = Field(0.15, gt=0, description="time without sight after which a younger one is closed")
    lost: float = Field(2.0, gt=0, description="time without sight after which any window is closed")
    same: float = Field(0.7, gt=0, description="windows nearer than this that move alike are one, fields")
    near: float = Field(2.6, gt=0, description="and nearer than this if they fluctuate alike")
    known: float = Field(0.7, gt=0, description="age of both from which on that counts")
    alike: float = Field(0.8, gt=0, description="correlation of fluctuations that are alike")
    alike_speed: float = Field(0.8, gt=0, description="difference of velocities that are alike, fields a second")
    tau_high: float = Field(1.0, gt=0, description="high-pass on a window's signals")
    tau_bind: float = Field(3.0, gt=0, description="memory of a window's covariances")
    tau_light: float = Field(1.0, gt=0, description="memory of the covariances between windows")
