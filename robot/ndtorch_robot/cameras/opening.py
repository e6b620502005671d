"""The camera pair of a configuration, corrected where there is a calibration."""

from __future__ import annotations

from collections.abc import Callable

from ndtorch.navigation import Rect, StereoRig
from ndtorch.navigation.options import NavigatorOptions
from ndtorch_robot.cameras.pair import StereoCameras
from ndtorch_robot.cameras.settings import CameraSettings
from ndtorch_robot.cameras.source import Opener, open_capture


def open_cameras(
    settings: CameraSettings,
    rig: StereoRig,
    fields: Callable[[StereoRig], tuple[Rect, Rect]] | None = None,
    opener: Opener = open_capture,
) -> tuple[StereoCameras, StereoRig]:
    """Open both cameras.

    Args:
        rig: where they are on the car.
        fields: the rectangles that navigation reads of a pair of this geometry; the default navigator's by default.

    Returns:
        The cameras, and the geometry that the navigator must be made with: with a calibration, `rig` with the
        baseline and the focal length that were measured.

    Raises:
        InputError: as `StereoCameras`; a calibration that cannot be read or is of another size.
    """
    if settings.calibration is None:
        return StereoCameras(settings, opener=opener), rig
    from ndtorch_robot.calibration import Rectifier, read_calibration

    calibration = read_calibration(settings.calibration)
    draft = Rectifier(calibration, rig)
    rectifier = Rectifier(calibration, rig, (fields or NavigatorOptions().fields)(draft.rig))
    return StereoCameras(settings, rectifier, opener), rectifier.rig
