"""Recordings for the rerun viewer: what was written can be read back."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from ndtorch.report.plots.layout import rgb
from ndtorch.report.recording import BATCH, Recording, why_not_whole
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
