"""Boxes in MOT and COCO form, boxes in the timeline, and the film of masks, from a run of the model foreground."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from ndtorch.cli.commands import main
from ndtorch.scenes.video_writer import VideoWriter
from tests.foreground.passing_scenes import SIZE, passing


def test_a_run_writes_boxes_for_other_programs_and_a_film_of_masks(tmp_path: Path) -> None:
    film = VideoWriter(tmp_path / "square.mp4", 25.0, SIZE)
    for frame in passing(45, 4.0, first=6):
        film.write((frame * 255).byte())
    film.close()
    out = tmp_path / "out"
    command = ["bind", str(tmp_path / "square.mp4"), "--model", "foreground", "--mask", "--out", str(out)]
    assert main(command) == 0
    folder = out / "square"
    rows = np.loadtxt(folder / "mot.txt", delimiter=",")
    assert set(rows[:, 1]) == {1}
    # The codec smears what moves.
    left, top, width, height = rows[rows[:, 0] == 31][0, 2:6]
    assert (left, top, width, height) == pytest.approx((96, 44, 24, 24), abs=7)
    boxes = json.loads((folder / "coco.json").read_text())
    assert len(boxes["annotations"]) == len(rows)
    assert boxes["annotations"][0]["track_id"] == 1
    assert {one["image_id"] for one in boxes["annotations"]} == {one["id"] for one in boxes["images"]}
    (thing,) = [json.loads(line) for line in (folder / "timeline.jsonl").read_text().splitlines()]
    assert len(thing["boxes"]) == len(thing["path"])
    first, place = thing["boxes"][3], thing["path"][3]
    assert first[0] < place[1] < first[2]
    assert first[1] < place[2] < first[3]
    masks = cv2.VideoCapture(str(folder / "mask.mp4"))
    assert int(masks.get(cv2.CAP_PROP_FRAME_COUNT)) == 45
    masks.set(cv2.CAP_PROP_POS_FRAMES, 30)
    mask = masks.read()[1][..., 0] > 127
    assert mask[50:62, 100:116].mean() > 0.9
    assert mask.mean() < 0.12
