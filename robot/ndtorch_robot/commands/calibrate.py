"""`ndtorch calibrate`."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from ndtorch.errors import InputError

if TYPE_CHECKING:
    from ndtorch_robot.cameras.source import Image

REFUSED = 1
"""Exit code for images that give no calibration worth driving with."""

NEW_RATIO = 0.06
"""Mean motion of the corners since every view kept, as a ratio to the width of the image, that makes a new view."""


@dataclass(frozen=True)
class Calibrate:
    """Measure two cameras with a chessboard.

    LEFT and RIGHT are two folders of images taken in pairs, or two cameras before which the board is then moved
    about: near and far, into every corner, tilted up to 35 degrees. Writes a YAML file, unless the result is too
    bad to drive with; docs/robot/calibration.md says how to do it and what the figures mean.
    """

    left: Annotated[str, tyro.conf.Positional]
    """Folder of the left images, or device, or address with ://."""
    right: Annotated[str, tyro.conf.Positional]
    """Folder of the right images, or device, or address with ://."""
    columns: int = 9
    """Inner corners along the longer side of the board."""
    rows: int = 6
    """Inner corners along the shorter side of the board."""
    square_mm: float = 40.0
    """Side of a square on the print, in mm."""
    out: Path = Path("calibration.yaml")
    """File for the calibration."""
    force: bool = False
    """Replace the file if it exists."""
    views: int = 20
    """Number of views that are taken of live cameras; Ctrl-C ends with fewer."""
    keep: Path | None = None
    """Folder for the images of the views of live cameras."""
    width: int = 640
    """Width of the images of live cameras, in pixels."""
    height: int = 480
    """Height of the images of live cameras, in pixels."""
    json: bool = False
    """Print the calibration as one JSON object and nothing else."""

    def run(self) -> int:
        import numpy as np

        from ndtorch.run.folder import new_file
        from ndtorch_robot.calibration import Board, BoardView, calibrate, find_view, write_calibration

        new_file(self.out, self.force)
        if self.views < 1:
            raise InputError(f"--views must be 1 or more, got {self.views}")
        board, views, pairs = Board(self.columns, self.rows, self.square_mm / 1000), list[BoardView](), 0
        live, size = not (Path(self.left).is_dir() or Path(self.right).is_dir()), (0, 0)
        with contextlib.suppress(KeyboardInterrupt):
            for left, right in self.live_pairs() if live else self.folder_pairs():
                pairs, size = pairs + 1, (left.shape[1], left.shape[0])
                view = find_view(left, right, board)
                if view is None or (
                    live and any(np.abs(view.left - v.left).mean() < NEW_RATIO * size[0] for v in views)
                ):
                    continue
                views.append(view)
                if live and self.keep is not None:
                    keep(self.keep, len(views), left, right)
                column, row = view.left.mean(0)
                print(f"  view {len(views)}: board at column {column:.0f}, row {row:.0f}", file=sys.stderr)
                if live and len(views) == self.views:
                    break
        calibration, quality = calibrate(views, board, size)
        faults, projection = quality.faults(), calibration.right.projection
        if not faults:
            write_calibration(calibration, quality, self.out)
        baseline = -float(projection[0, 3] / projection[0, 0])
        if self.json:
            print(json.dumps({"accepted": not faults, "faults": faults, "baseline_m": baseline, **quality._asdict()}))
        else:
            print(f"{size[0]}x{size[1]}, {quality.views} of {pairs} pairs, baseline {1000 * baseline:.2f} mm")
            for name, value in quality._asdict().items():
                print(f"  {name:16}{value:.3g}")
            print("REFUSED: " + "\n         ".join(faults) if faults else f"written to {self.out}")
        return REFUSED if faults else 0

    def live_pairs(self) -> Iterator[tuple[Image, Image]]:
        from ndtorch_robot.cameras.pair import CamerasSilent, StereoCameras
        from ndtorch_robot.cameras.source import CameraSettings

        size = {"width_px": self.width, "height_px": self.height}
        with StereoCameras(CameraSettings(left=self.left, right=self.right, max_age_ms=500.0, **size)) as cameras:
            while True:
                with contextlib.suppress(CamerasSilent):
                    pair = cameras.read_pair()
                    yield pair.left.image, pair.right.image

    def folder_pairs(self) -> Iterator[tuple[Image, Image]]:
        import cv2

        from ndtorch.scenes.readers import image_files, read_image

        files = []
        for folder in (self.left, self.right):
            if not Path(folder).is_dir():
                raise InputError(f"{folder}: no such folder")
            files.append(image_files(Path(folder))[0])
        if len(files[0]) != len(files[1]):
            raise InputError(f"the folders must hold as many images, got {len(files[0])} and {len(files[1])}")
        size = None
        for paths in zip(*files, strict=True):
            images: list[Any] = [read_image(path, cv2.IMREAD_GRAYSCALE) for path in paths]
            for path, image in zip(paths, images, strict=True):
                if image is None or image.shape != (size := size or image.shape):
                    raise InputError(f"{path}: not an image, or not of the size of the others")
            yield images[0], images[1]


def keep(folder: Path, number: int, left: Image, right: Image) -> None:
    """Write a pair as `left/001.png` and `right/001.png`, for `ndtorch calibrate folder/left folder/right`."""
    import cv2

    for side, image in (("left", left), ("right", right)):
        (folder / side).mkdir(parents=True, exist_ok=True)
        (folder / side / f"{number:03d}.png").write_bytes(cv2.imencode(".png", image)[1].tobytes())
