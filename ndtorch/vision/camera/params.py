"""What the front end for video does, and its constants."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ndtorch.config import Constants, Deviations, Shares


class CameraParams(Constants):
    """What the front end does, and its constants."""

    exposure: bool = Field(True, description="divide every color by its gain against the background")
    background: bool = Field(True, description="signals from the difference to a slow background, not from the frame")
    noise_floor: bool = Field(True, description="take nothing from what does not stand out from the measured noise")
    color_inhibition: bool = Field(True, description="colors of a pixel inhibit one another, so that white has none")
    scale: int | Literal["auto"] = Field("auto", description="level of the pyramid for motion, 0 to 2, or by the shift")
    compression: bool = Field(True, description="square root of the signals")
    grid: tuple[int, int] = Field((6, 10), description="rows and columns of fields; [1, 1] for the whole field")
    height: int = Field(56, ge=16, le=32_768, description="rows of the small image on which everything is computed")
    fastest: float = Field(30.5, gt=0, description="frames a second beyond which successive frames are averaged")
    tau_background: float = Field(10.0, ge=0, description="memory of the background")
    tau_deviation: float = Field(4.0, ge=0, description="memory of the noise of every pixel")
    hold: float = Field(0.2, ge=0, description="pace of the background where something stands out, as a share")
    spread: float = Field(3.5, gt=0, description="standard deviations of the noise that count as standing out")
    tau_high: float = Field(0.5, ge=0, description="high-pass of the motion detectors")
    tau_low: float = Field(0.05, ge=0, description="delay filter of the motion detectors")
    center: Deviations = Field((2.85, 0.9), description="deviations of the orientation filters, small pixels:")
    surround: Deviations = Field((3.3, 1.35), description="those published for 500 pixels, brought to 56")
    gain_limit: float = Field(4.0, ge=1, description="largest gain of the exposure, and 1 / the smallest")
    darkest: float = Field(0.04, gt=0, description="background darker than this says nothing about gain")
    lit: float = Field(0.1, ge=0, le=1, description="nor does one of which less than this share is brighter")
    first_deviation: float = Field(0.01, ge=0, description="deviation of a pixel before anything is known of it,")
    first_frames: float = Field(5.0, ge=1, description="which counts as much as this many frames")
    quietest: float = Field(1 / 1024, gt=0, description="smallest noise")
    outlier: float = Field(3.0, ge=1, description="a deviation counts as no more than this many times what is known")
    growth: float = Field(1.5, ge=1, description="noise is no more than this many times what is known of it")
    cut: float = Field(0.6, gt=0, description="what stands out in more than this share of the picture is a new scene")
    tau_exposure: float = Field(10.0, ge=0, description="the background takes on the exposure of the frames")
    best_shift: float = Field(1.5, gt=0, description="pixels that a pattern should move within a detector's delay")
    tau_shift: float = Field(1.0, gt=0, description="memory of the displacement that the scale is chosen by")
    palest: float = Field(0.02, gt=0, description="a hue of less than this is none: white, grey or black,")
    pale: float = Field(0.12, ge=0, description="nor is one of less than this share of the brightness")
    shade: float = Field(0.25, ge=0, le=1, description="a shade counts this much beside a hue")
    white: Shares = Field((0.5, 0.7), description="white is from here to there, of the brightest,")
    black: Shares = Field((0.12, 0.25), description="black below, and grey between")
    dimmest_white: float = Field(0.02, gt=0, description="smallest mean of a color that white is told from")
