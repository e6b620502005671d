"""What a run with tracks says when nothing is found or the camera moves, and the pictures that it keeps."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest

from ndtorch.binding import BoundObject
from ndtorch.report.camera_motion import MIN_SHIFT_PX, CameraMotion, global_shift
from ndtorch.report.gallery import CROP_SIDE, GROUNDS, Gallery, contact_sheet
from ndtorch.report.mask_store import MaskStore
from ndtorch.report.no_objects import advice
from ndtorch.run.result import RunResult
from ndtorch.run.watchers import Picture
from tests.report.test_page import CAR, run_of

FOLDER = Path(__file__).parents[3] / "shared" / "data" / "video"
RNG = np.random.default_rng(5)
TEXTURE = np.asarray(cv2.GaussianBlur(RNG.uniform(0, 255, (160, 260, 3)), (0, 0), 2), np.uint8)


def view(down: float = 0, across: float = 0, turn: float = 0) -> np.ndarray:
    """120 x 192 pixels of a texture, shifted, and turned by degrees."""
    move = cv2.getRotationMatrix2D((110, 80), turn, 1)
    move[:, 2] -= (20 + across, 20 + down)
    return np.asarray(cv2.warpAffine(TEXTURE, move, (192, 120)), np.uint8)


def grey(image: np.ndarray) -> np.ndarray:
    return np.asarray(image.mean(2), np.uint8)


@pytest.mark.parametrize(("down", "across"), [(0, 0), (0, 2), (3, -4), (0.5, 0.5)])
def test_the_shift_of_all_of_an_image_is_measured(down: float, across: float) -> None:
    assert global_shift(grey(view()), grey(view(down, across))) == pytest.approx(np.hypot(down, across), abs=0.15)


def test_a_turn_is_a_shift_and_an_object_is_none() -> None:
    assert global_shift(grey(view()), grey(view(turn=3))) > MIN_SHIFT_PX
    passing = view()
    passing[20:100, 20:100] = view(0, 30)[20:100, 20:100]
    assert global_shift(grey(view()), grey(passing)) < 0.15
    assert global_shift(grey(view()), np.full((120, 192), 90, np.uint8)) == 0
    assert global_shift(np.full((120, 192), 90, np.uint8), grey(view())) == 0


def watched(frames: list[np.ndarray], fps: float = 5.0) -> CameraMotion:
    camera = CameraMotion()
    for n, frame in enumerate(frames):
        camera.picture(Picture(n / fps, frame))
    return camera


def test_a_camera_that_begins_to_pan_is_told_within_two_seconds() -> None:
    pan = [view()] * 10 + [view(0, 2 * n) for n in range(1, 9)]
    camera = watched(pan)
    assert camera.since == pytest.approx(2.0)
    (line,) = advised(run_of([CAR], owners=False), camera)
    assert line.startswith("the camera moves, from 2.0 s on (all of the image moved in 8 of 17 pictures)")
    assert watched(pan[:12]).since is None  # a knock


@pytest.mark.parametrize("folder", sorted(FOLDER.glob("*/clip.mp4"))[:2] or [None])
def test_static_cameras_do_not_move(folder: Path | None) -> None:
    if folder is None:
        pytest.skip("needs the labelled clips of ../shared/data/video")
    from ndtorch_train.benchmark.mot import read_clip

    clip = read_clip(folder.parent).clip
    step = max(1, round(clip.fps / 5))
    camera = watched([np.asarray(frame[..., ::-1], np.uint8) for frame in islice(clip.frames, 0, 50 * step, step)])
    assert camera.since is None
    assert camera.shifted <= 0.05 * camera.compared


@pytest.mark.parametrize(("kind", "moves"), [("panning", True), ("shaking", True), ("lanes", False)])
def test_generated_cameras(kind: str, moves: bool) -> None:
    from ndtorch_train.benchmark.street_clips import StreetFrames

    camera = watched([frame[..., ::-1] for frame in islice(StreetFrames(kind, 3), 0, 24, 2)])
    assert (camera.since is not None) == moves


def advised(result: RunResult, camera: CameraMotion, labels: Sequence[np.ndarray] = ()) -> tuple[str, ...]:
    """Advice with masks of such labels."""
    with closing(MaskStore()) as store:
        for n, each in enumerate(labels):
            store.add(n / 5, each.astype(np.int32))
        return advice(result, camera, store)


def test_no_objects_has_a_reason_and_a_next_step() -> None:
    still, empty = watched([view()] * 5), run_of([], owners=False)
    (line,) = advised(empty, still)
    assert line.startswith("nothing moved")
    empty.simulated_seconds = 0.8
    assert advised(empty, still)[0].startswith("the video is 0.8 s long")
    empty.simulated_seconds, empty.full_size = 8.0, (240, 384)
    region = np.zeros((60, 96))
    region[10:14, 10:20] = 1
    (line,) = advised(empty, still, [region, np.roll(region, 3, 1)])
    assert line.startswith("1 region differed from the background, the largest 40 pixels wide")
    assert "at most 12 pixels" in line
    blink = view()
    blink[50:54, 50:56] ^= 128
    (line,) = advised(empty, watched([view(), blink]))
    assert line.startswith("everything that moved is smaller than the model takes")


def test_objects_without_a_moving_camera_need_no_advice() -> None:
    assert advised(run_of([CAR], owners=False), watched([view()] * 3)) == ()


def thing(number: int, box: tuple[float, float, float, float]) -> BoundObject:
    return BoundObject("red", 7, {}, place=(0, 0), track=number, number=number, boxes=(box,))


def test_gallery_keeps_ground_crops_and_poster_in_bounded_memory() -> None:
    gallery, ground = Gallery(), view()
    for n in range(60):
        frame = ground.copy()
        frame[40:70, 3 * n : 3 * n + 12] = (255, 0, 0)
        seen = () if n < 5 else (thing(1, (3 * n, 40, 3 * n + 12, 70)),)
        gallery.picture(Picture(n / 5, frame, objects=(*seen, thing(2, (80, 90, 90, 95))) if n == 30 else seen))
    assert len(gallery._kept) <= GROUNDS
    np.testing.assert_array_equal(gallery.ground(), ground)
    assert gallery.poster is not None
    assert {one.number for one in gallery.poster[1]} == {1, 2}
    assert set(gallery.crops) == {1, 2}
    red = (gallery.crops[1].pixels == (255, 0, 0)).all(2)
    assert 0.3 < red.mean() < 0.6  # the object and a rim
    sheet = contact_sheet(gallery.crops)
    assert sheet is not None
    assert sheet.shape[1] == 2 * (CROP_SIDE + 8)
    assert contact_sheet({}) is None
    assert Gallery().ground() is None
