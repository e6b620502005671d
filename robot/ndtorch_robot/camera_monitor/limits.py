"""The limits by which camera images are judged."""

from __future__ import annotations

from pydantic import ConfigDict, Field

from ndtorch.utils.toml import Strict


class CameraLimits(Strict):
    """`[camera_monitor]`: when a camera counts as blind, frozen or wrongly mounted.

    A level is one of the 256 brightness levels of a pixel. Row and subfield are the pixels that navigation reads.
    """

    model_config = ConfigDict(use_attribute_docstrings=True)

    patience_s: float = Field(0.25, ge=0.05, le=60)
    """Images must look wrong for this time, in s, before the car stops; frozen ones count twice."""
    row_contrast_levels: float = Field(1.2, gt=0)
    """A row shows nothing below this standard deviation of its block means without shading, in levels."""
    field_contrast_levels: float = Field(0.6, gt=0)
    """A subfield shows nothing below this standard deviation of its block means, in levels."""
    row_contrast_ratio: float = Field(0.05, ge=0, le=1)
    """A row is foggy below this ratio of standard deviation to mean brightness."""
    field_contrast_ratio: float = Field(0.012, ge=0, le=1)
    """A subfield is foggy below this ratio of standard deviation to mean brightness."""
    sharpness_ratio: float = Field(0.2, ge=0, le=1)
    """A row is blurred when no step over two pixels is larger than this ratio of its range."""
    noise_levels: float = Field(10.0, gt=0)
    """A row may be noise from this root mean square step between pixels, in levels."""
    min_range_levels: float = Field(20.0, gt=0)
    """The sharpness of a row is not judged below this range of brightness, in levels."""
    soft_edge_ratio: float = Field(0.36, ge=0, le=1)
    """Over a floor without texture a row is blurred when no step over two blocks is larger than this ratio of its
    range."""
    moved_m: float = Field(0.02, gt=0)
    """After this distance driven, in m, the images must have changed."""
    turned_rad: float = Field(0.025, gt=0)
    """After this turn, in rad, the images must have changed."""
    row_change_levels: float = Field(1.0, gt=0)
    """A row is unchanged below this standard deviation of its change, in levels."""
    field_change_levels: float = Field(0.45, gt=0)
    """A subfield is unchanged below this standard deviation of its change, in levels."""
    static_correlation: float = Field(0.5, ge=-1, le=1)
    """Images of a stationary car have moved when their correlation over 0.4 s is below this value."""
    chance_correlation: float = Field(0.05, ge=0, le=2)
    """A match on the wrong side counts by how much its correlation exceeds the right one's by more than this."""
    swapped_sum: float = Field(8.0, gt=0)
    """Cameras are swapped or turned when matches on the wrong side add up to this sum."""
    mirrored_sum: float = Field(3.0, gt=0)
    """A camera is upside down when matches of mirrored patches add up to this sum."""
    min_turns: float = Field(3.0, gt=0)
    """The direction of image motion is judged after this weighted number of turns."""
    reversed_log_ratio: float = Field(0.3, ge=0, le=3)
    """A camera is upside down when the wrong direction of turning explains its images better by this mean logarithm of
    the ratio of residuals."""
