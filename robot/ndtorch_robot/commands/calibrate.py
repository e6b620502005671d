"""`ndtorch calibrate`."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ndtorch.errors import InputError

if TYPE_CHECKING:
    from ndtorch_robot.calibration import Board, Calibration, View

REFUSED = 1
"""Exit code for images that give no calibration worth driving with."""


@dataclass(frozen=True)
class Calibrate:
    """Measure two cameras with a chessboard.

    LEFT and RIGHT are two folders of images taken in pairs, or two cameras before which the board is then moved
    about: near and far, into every corner, tilted up to 35 degrees. Writes a TOML file, unless the result is too
    bad to drive with; docs/robot/calibration.md says how to do it and what the figures mean.
    """

    left: Annotated[str, tyro.conf.Positional]
    """The left images are read from this folder, or from this device, video file or address with ://."""
    right: Annotated[str, tyro.conf.Positional]
    """The right images are read from here."""
    columns: int = 9
    """The board has this number of inner corners along its longer side."""
    rows: int = 6
    """The board has this number of inner corners along its shorter side."""
    square_mm: float = 40.0
    """A square has this side on the print, in mm."""
    out: Path = Path("calibration.toml")
    """The calibration is written into this file."""
    force: bool = False
    """The file is replaced if it exists."""
    focal_px: float | None = None
    """The rectified images have this focal length, in pixels (default: that of the cameras)."""
    views: int = 20
    """Live, this number of views is taken."""
    seconds: float = 300.0
    """Live, taking the views ends after this time, in s."""
    keep: Path | None = None
    """Live, the images of the views are kept in this folder."""
    width: int = 640
    """Live, the images have this width, in pixels."""
    height: int = 480
    """Live, the images have this height, in pixels."""
    json: bool = False
    """The calibration is printed as one JSON object, and nothing else is."""

    def run(self) -> int:
        from ndtorch.run.folder import new_file
        from ndtorch_robot.calibration import Board, calibrate, faults, write_calibration

        new_file(self.out, self.force)
        board = Board(self.columns, self.rows, self.square_mm / 1000)
        views, size, looked = self.look(board)
        calibration = calibrate(views, board, size, self.focal_px)
        wrong = faults(calibration.quality)
        if not wrong:
            write_calibration(calibration, self.out)
        if self.json:
            print(json.dumps({"accepted": not wrong, "faults": wrong, **calibration.model_dump(mode="json")}))
        else:
            print(describe(calibration, looked))
            print(f"written to {self.out}" if not wrong else "REFUSED: " + "\n         ".join(wrong))
        return REFUSED if wrong else 0

    def look(self, board: Board) -> tuple[list[View], tuple[int, int], int]:
        """The views, the size of the images, and how many pairs there were."""
        from ndtorch_robot.calibration import folder_pairs
        from ndtorch_robot.calibration.collect import collect, from_files

        def seen(count: int, view: View) -> None:
            if not self.json:
                where = view.left.mean(0)
                print(f"  view {count}: board at column {where[0]:.0f}, row {where[1]:.0f}", file=sys.stderr)

        folders = Path(self.left), Path(self.right)
        if any(folder.is_dir() for folder in folders):
            pairs = folder_pairs(*folders)
            views, size = from_files(pairs, board, seen)
            return views, size, len(pairs)
        if self.views < 1 or not 0 < self.seconds <= 86400:
            raise InputError(f"expected --views >= 1 and --seconds > 0, got {self.views} and {self.seconds}")
        from ndtorch.utils.toml import check
        from ndtorch_robot.cameras import StereoCameras
        from ndtorch_robot.cameras.source import CameraSettings

        values: dict[str, object] = {
            "left": self.left,
            "right": self.right,
            "width_px": self.width,
            "height_px": self.height,
            "max_age_ms": 500.0,
        }
        with StereoCameras(check(values, CameraSettings, "calibrate")) as cameras:
            views = collect(cameras, board, self.views, self.seconds, seen, self.keep)
            return views, (self.width, self.height), cameras.statistics().pairs


def describe(calibration: Calibration, looked: int) -> str:
    c, q = calibration, calibration.quality
    turn = [57.29578 * angle for angle in c.rotation_rad]
    return "\n".join(
        [
            f"{c.width_px}x{c.height_px}, {q.views} of {looked} pairs used, boards cover {q.covered_percent:.0f} %",
            f"  baseline {1000 * c.baseline_m:.2f} mm, rectified focal length {c.focal_px:.2f} px "
            f"(known to {q.focal_percent:.2f} %)",
            f"  right camera turned by {turn[0]:+.2f}, {turn[1]:+.2f}, {turn[2]:+.2f} degrees (down, aside, roll)",
            f"  reprojection {q.left_px:.3f} px left, {q.right_px:.3f} px right, {q.pair_px:.3f} px together",
            f"  rows of the corrected pair differ by {q.row_px:.3f} px, 95 % by less than {q.row_95_px:.3f} px",
            f"  squares measured by the corrected pair: {q.square_percent:+.3f} % off",
        ]
    )
