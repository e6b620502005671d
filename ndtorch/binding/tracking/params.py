"""Constants of windows."""

from __future__ import annotations

from pydantic import Field

from ndtorch.config import Constants


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
