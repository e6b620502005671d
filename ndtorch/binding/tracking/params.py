"""Constants of detections and tracks."""

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
    same_color: float = Field(0.8, description="and the outputs of their colors are this alike,")
    same_way: float = Field(0.7, description="and their directions of motion")
    gate: float = Field(0.25, gt=0, description="how far from where a track is expected a detection may be,")
    reach: float = Field(0.3, ge=0, description="and how much further a second later")
    unlike: float = Field(0.5, ge=0, description="cost of nothing in common, where a gate's distance costs 1")
    turn: float = Field(0.8, ge=0, description="cost of moving the other way")
    tau_velocity: float = Field(0.4, ge=0, description="a detection after t changes the velocity by t / (this + t)")
    coast: float = Field(1.2, ge=0, description="how long a track out of sight is waited for")
    shortest: float = Field(0.4, ge=0, description="smallest time in sight of an object")
    travel: float = Field(0.15, ge=0, description="smallest way gone")
    straight: float = Field(0.6, ge=0, description="smallest agreement of its directions, 0 to 1")
    alike: float = Field(0.8, description="likeness of colors from which on two tracks may be of parts of one object")
    along: float = Field(0.7, description="and likeness of their ways")
    together: float = Field(0.3, ge=0, description="share of common times of tracks side by side")
    beside: float = Field(0.25, ge=0, description="parts of one object stay this near to each other")
    behind: float = Field(2.0, ge=0, description="an object may be hidden this long,")
    comes_back: float = Field(0.5, ge=0, description="and comes back this near to where it was heading")
