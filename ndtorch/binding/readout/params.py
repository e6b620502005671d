"""Constants of the read-outs of the scale-free network."""

from __future__ import annotations

from pydantic import Field

from ndtorch.config import Constants


class OwnerCriteria(Constants):
    """What an owner must be."""

    strength: float = Field(0.35, ge=0, description="owner: its deviation as a share of the largest,")
    kept: float = Field(0.55, ge=0, description="and of its own input's,")
    faint: float = Field(0.05, ge=0, description="and its smallest, where fluctuations of a group are around 1,")
    rough: float = Field(0.15, ge=0, description="its largest roughness (of samples 10 ms apart),")
    alike: float = Field(0.6, ge=-1, le=1, description="and largest correlation with a stronger owner")
    smallest: float = Field(1 / 3, ge=0, description="share of its group's largest that makes a feature")


class SourceCriteria(Constants):
    """When sources found by delays are believed, and how they are looked for."""

    most_sources: int = Field(6, gt=0, le=10, description="largest number of sources")
    gap: float = Field(0.02, ge=0, description="difference of delay profiles that tells two sources apart")
    even: float = Field(0.65, ge=0, description="evenness of colors and orientations of light that changes everywhere,")
    moving: float = Field(0.35, ge=0, description="if it has less than this share of the largest motion")
    absent: float = Field(0.1, ge=0, description="and no color or orientation is one below this share of its largest")
    sweeps: int = Field(12, gt=0, description="rounds of rotations at most,")
    enough: float = Field(1e-6, ge=0, description="and their largest angle in radians that ends them")


class SumCriteria(Constants):
    """When a direction of the sums holds a source: eigenvalues of the covariance at the shortest delay."""

    faintest: float = Field(3e-4, ge=0, description="share of the largest, of orientations and colors,")
    crowd: int = Field(4, gt=0, le=6, description="from so many sources on motion is counted too,")
    apart: float = Field(4.0, ge=0, description="the last of these against the weakest direction,")
    alone: float = Field(30.0, ge=1, description="or the weakest but one against the weakest, if that is quiet,")
    least_alone: float = Field(1e-4, ge=0, description="with this share of the largest; the third weakest likewise,")
    crowded: float = Field(0.0065, ge=0, description="share of the largest where motion is counted,")
    colored: float = Field(2.3, ge=0, description="and more than this times the mean of the three weakest,")
    white: float = Field(0.25, ge=0, description="and this share of the same without delay")
    clear: float = Field(4.0, ge=0, description="the largest against the three weakest, or all is noise")
    left: float = Field(0.1, ge=0, description="power lately against that of its memory, of what has left")
    least: float = Field(0.01, ge=0, description="deviation against the level, or nothing fluctuates")
    doubtful: float = Field(2e-3, ge=0, description="share of the largest of a further source beside two of one rate")
    lit: float = Field(0.012, ge=0, description="sine of the angle between even light and the sources: it is one,")
    unmoved: float = Field(0.1, ge=0, description="if its share of the largest motion is below this")
    moved: float = Field(0.115, ge=0, description="share of the largest motion without a source that makes one more,")
    elsewhere: float = Field(0.03, ge=0, description="the same another way than all sources move,")
    quiet: float = Field(5e-4, ge=0, description="where noise is less than this share of the largest")
    covered: float = Field(
        8.0, ge=1, description="times the median, in a second, of what orientations hold beside colors: it is left out,"
    )
    beside: float = Field(3e-4, ge=0, description="if this is more than so large a share of the orientations")
    surprise: float = Field(40.0, gt=0, description="times more power than known that makes a new scene,")
    seen_for: float = Field(1.5, ge=0, description="which is believed when it was seen for this long")
