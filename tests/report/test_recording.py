"""Recordings for the rerun viewer: what was written can be read back."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

import ndtorch
from ndtorch.binding import BoundObject
from ndtorch.errors import InputError
from ndtorch.report.films import EnhancedVideo, Overlay, clocked, even, mark_of, marked
from ndtorch.report.plots.layout import rgb
from ndtorch.report.recording import BATCH, Recording, why_not_whole
from ndtorch.report.responses import NAMES, ResponseFile, to_xarray
from ndtorch.run.run import run_model
from ndtorch.run.watchers import Picture
from ndtorch.scenes import two_bars
from ndtorch.vision.features import FEATURES

rerun = pytest.importorskip("rerun")


def picture(height: int = 20, width: int = 30) -> np.ndarray[Any, Any]:
    return np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)


def chunks(path: Path, entity: str, static: bool = False) -> list[Any]:
    from rerun.chunk import RrdReader

    found = RrdReader(path).stream().to_chunks()
    return [chunk for chunk in found if chunk.entity_path == entity and chunk.is_static == static]


def column(chunk: Any, name: str) -> list[Any]:
    values: list[Any] = chunk.to_record_batch().column(name).to_pylist()
    return values


def test_everything_written_is_there(tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    path = tmp_path / "new" / "run.rrd"
    steps = BATCH + 44
    with Recording(path) as recording:
        for step in range(steps):
            recording.outputs(step / 100, torch.full((10,), float(step)))
        for step in range(5):
            recording.frame(step / 25, picture(), picture(), "red wins")
            recording.weights(step / 25, torch.full((10, 10), step / 10))
        recording.objects("red, moving right")
    reader = RrdReader(path)
    assert len(reader.recordings()) == 1
    assert len(reader.blueprints()) == 1
    rows: Counter[str] = Counter()
    for chunk in reader.stream().to_chunks():
        if not chunk.is_static:
            assert "time" in chunk.timeline_names
            rows[chunk.entity_path] += chunk.num_rows
    assert rows == {"/outputs": steps, "/input": 5, "/enhanced": 5, "/winner": 5, "/weights/matrix": 5, "/objects": 1}


def test_outputs_keep_their_times_values_names_and_colors(tmp_path: Path) -> None:
    with Recording(tmp_path / "run.rrd") as recording:
        for step in range(3):
            recording.outputs(step / 4, torch.arange(10) + step)
    (chunk,) = chunks(tmp_path / "run.rrd", "/outputs")
    assert [time.total_seconds() for time in column(chunk, "time")] == [0, 0.25, 0.5]
    assert column(chunk, "Scalars:scalars")[2] == list(range(2, 12))
    (style,) = chunks(tmp_path / "run.rrd", "/outputs", static=True)
    assert column(style, "SeriesLines:names")[0] == list(FEATURES)
    red, green, blue = rgb("red")
    assert column(style, "SeriesLines:colors")[0][7] == int.from_bytes((red, green, blue, 255))


def test_an_error_inside_still_closes_the_file(tmp_path: Path) -> None:
    def interrupted(recording: Recording) -> None:
        with recording:
            recording.outputs(0.0, torch.zeros(10))
            raise KeyboardInterrupt

    recording = Recording(tmp_path / "run.rrd")
    with pytest.raises(KeyboardInterrupt):
        interrupted(recording)
    assert chunks(tmp_path / "run.rrd", "/outputs")[0].num_rows == 1
    recording.close()


def test_half_a_recording_is_told(tmp_path: Path) -> None:
    """As a full disk leaves it, of which the SDK only logs."""
    path = tmp_path / "run.rrd"
    with Recording(path) as recording:
        recording.frame(0.0, picture(), picture(), "nothing")
    assert why_not_whole(path) is None
    whole = path.read_bytes()
    for length in (0, 40, len(whole) // 2, len(whole) - 70):
        path.write_bytes(whole[:length])
        assert why_not_whole(path) == f"the recording {path} is not whole: the disk was full, or failed"
    path.unlink()
    assert "No such file" in str(why_not_whole(path))


def test_a_program_ends_whose_disk_was_full(tmp_path: Path) -> None:
    """The writer of the SDK is gone then, and nobody may wait for it."""
    program = (
        "import resource, sys\n"
        "import numpy as np, rerun as rr\n"
        "from ndtorch.report.recording import end_stream\n"
        "stream = rr.RecordingStream('x')\n"
        "stream.set_sinks(rr.FileSink(sys.argv[1]))\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, resource.RLIM_INFINITY))\n"
        "for _ in range(20):\n"
        "    stream.log('a', rr.Image(np.random.randint(0, 255, (200, 200, 3), dtype=np.uint8)))\n"
        "end_stream(stream, patience=1.0)\n"
        "print('ended')\n"
    )
    file = tmp_path / "half.rrd"
    done = subprocess.run(
        [sys.executable, "-c", program, file], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stdout) == (0, "ended\n"), done.stderr
    assert why_not_whole(file) is not None


FRAME = np.zeros((60, 80, 3), dtype=np.uint8)


def thing(first_seen: float = 0.0, **more: object) -> BoundObject:
    kept = {"place": (30.0, 20.0), "first_seen": first_seen, "last_seen": 1.0, "heading": (1.0, 0.2)} | more
    return BoundObject("red", 7, {"red": 1.0, "right": 1.0}, **kept)  # type: ignore[arg-type]


def inked(image: np.ndarray, color: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the pixels of that color."""
    rows, columns = np.nonzero((image == np.array(color)).all(-1))
    return rows, columns


def test_an_object_is_marked_in_its_color_where_it_is_with_an_arrow_where_it_goes() -> None:
    image = marked(FRAME, (thing(),))
    rows, columns = inked(image, rgb("red"))
    assert len(rows) > 20
    assert abs(np.median(rows) - 20) <= 2
    assert rows.min() >= 13
    # The arrow sticks out to the right.
    assert columns.max() - 30 > 30 - columns.min()
    assert FRAME.max() == 0


@pytest.mark.parametrize("size", [(61, 81), (60, 80)])
def test_films_have_an_even_size_and_every_picture(size: tuple[int, int], tmp_path: Path) -> None:
    frame = np.zeros((*size, 3), dtype=np.uint8)
    overlay, enhanced = Overlay(tmp_path / "o.avi", 5, size), EnhancedVideo(tmp_path / "e.avi", 5, size)
    for number in range(3):
        overlay.picture(Picture(number / 5, frame, objects=(thing(),)))
        enhanced.picture(Picture(number / 5, frame, frame + 200, 7))
    overlay.close()
    enhanced.close()
    assert even(size) == (60, 80)
    for name, width in (("o", 80), ("e", 160)):
        film = cv2.VideoCapture(str(tmp_path / f"{name}.avi"))
        assert (film.get(cv2.CAP_PROP_FRAME_COUNT), film.get(cv2.CAP_PROP_FRAME_WIDTH)) == (3, width)
    _, picture = film.read()
    assert picture[:, 100:].mean() > 150 > picture[:, :60].mean()


def test_the_overlay_has_number_label_and_clock() -> None:
    frame = np.zeros((120, 160, 3), dtype=np.uint8)
    plain, numbered = marked(frame, (thing(),)), marked(frame, (thing(number=5),))
    assert mark_of(thing(number=5)) == "#5"
    assert (plain != numbered).any()
    clock = clocked(frame, 1.5)
    rows, _ = np.nonzero(clock.max(-1))
    assert rows.min() > 60
    assert (clock != clocked(frame, 2.5)).any()
    assert frame.max() == clocked(FRAME, 1.5).max() == 0  # no room for letters


def test_the_table_has_every_step_and_an_answer_a_second(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    scene = two_bars(seconds=2.5, size=(96, 96), fps=25)
    model = ndtorch.load("scale-free", size=scene.size, fps=scene.fps)
    file = ResponseFile(tmp_path / "responses.parquet", model)
    result = run_model(model, scene, pictures_per_second=0, watchers=(file,))
    file.close()
    assert file.trouble is None
    table = parquet.read_table(tmp_path / "responses.parquet").to_pydict()
    with torch.inference_mode():
        signals, _ = model(scene.frames(0, scene.length))
    assert table["time"] == pytest.approx(signals.time.tolist())
    for kind, values in (("input", signals.inputs), ("output", signals.outputs)):
        found = np.stack([table[f"{kind}_{name}"] for name in NAMES], -1)
        np.testing.assert_allclose(found, values.numpy(), atol=1e-6)
    answers = [row for row in zip(table["objects"], table["weights"], strict=True) if row[0] is not None]
    assert 2 <= len(answers) <= 4
    assert np.shape(answers[-1][1]) == (100,)
    assert all(0 <= value <= 1 for value in table["confidence"] if value is not None)
    assert result.frames == scene.length


def test_arrays_have_trials_times_and_features() -> None:
    xarray = pytest.importorskip("xarray")
    model = ndtorch.load("published", size=(48, 48), fps=100)
    with torch.inference_mode():
        signals, _ = model(torch.rand(2, 20, 3, 48, 48))
    data = to_xarray(signals)
    assert isinstance(data, xarray.Dataset)
    assert dict(data.sizes) == {"trial": 2, "time": len(signals.time), "feature": 10}
    red = data.sums.sel(feature="red", trial=1).values
    np.testing.assert_array_equal(red, signals.sums[1, :, 7].numpy())


def test_other_signals_are_refused() -> None:
    with pytest.raises(InputError, match="signals must be"):
        to_xarray(torch.rand(5, 10))  # type: ignore[arg-type]
