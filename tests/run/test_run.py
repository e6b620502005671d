"""A model over a source, and the options of a run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import torch
from torch import Tensor, nn

from ndtorch.binding import BoundObject, ObjectTable
from ndtorch.errors import InputError
from ndtorch.run.folder import RunFolder
from ndtorch.run.result import Picture, Watcher
from ndtorch.run.run import run_model
from ndtorch.scenes import FrameSource


class StubSignals(NamedTuple):
    outputs: Tensor
    time: Tensor


class StubState(NamedTuple):
    frames: Tensor


class StubModel(nn.Module):
    """Tracks one object along the columns, a pixel a frame; its outputs become NaN in frame `breaks`."""

    name, tracks, settle, group = "stub", True, 0.0, 0

    def __init__(self, fps: float = 10.0, breaks: int | None = None) -> None:
        super().__init__()
        self.fps, self.dt, self.size, self.breaks = fps, 1 / fps, (16, 16), breaks
        self.chunks: list[int] = []

    def forward(self, frames: Tensor, state: Any = None) -> tuple[StubSignals, StubState]:
        done = 0 if state is None else int(state.frames)
        self.chunks.append(len(frames))
        numbers = torch.arange(done, done + len(frames))
        outputs = numbers[:, None, None, None] * torch.ones(len(frames), 2, 3, 10)
        if self.breaks is not None:
            outputs[numbers >= self.breaks] = torch.nan
        return StubSignals(outputs, numbers.double() / self.fps), StubState(torch.tensor(done + len(frames)))

    def objects(self, state: StubState) -> list[BoundObject]:
        last = int(state.frames) - 1
        path = tuple((n / self.fps, float(n), 4.0) for n in range(last + 1))
        seen = {"first_seen": 0.0, "last_seen": last / self.fps, "track": 0, "heading": (1.0, 0.0)}
        return [BoundObject("red", 7, {"red": 1.0}, (float(last), 4.0), (self.fps, 0.0), path=path, **seen)]  # type: ignore[arg-type]

    def visible_objects(self, state: StubState) -> list[BoundObject]:
        return self.objects(state)

    def table(self, state: StubState) -> ObjectTable:
        raise AssertionError("of models with owners only")

    def verdict(self, state: StubState) -> str:
        return "stable"

    def confidence(self, state: StubState) -> None:
        return None

    def weights(self, state: StubState) -> Tensor:
        return torch.full((10, 10), float(state.frames))


class Count(FrameSource):
    """Frames whose brightness is their number; after `broken` of them somebody presses Ctrl-C."""

    def __init__(self, length: int, fps: float = 10.0, broken: int | None = None) -> None:
        self.name, self.fps, self.size, self.length, self.broken = "count", fps, (16, 16), length, broken

    def chunks(self, frames: int = 8, start: int = 0) -> Iterator[Tensor]:
        for first in range(start, self.length or 0, frames):
            if self.broken is not None and first >= self.broken:
                raise KeyboardInterrupt
            numbers = torch.arange(first, min(first + frames, self.length or 0), dtype=torch.uint8)
            yield numbers[:, None, None, None].expand(-1, 3, 16, 16).clone()


class Notes(Watcher):
    """Keeps everything that it is shown."""

    def __init__(self) -> None:
        self.pictures: list[Picture] = []
        self.times: list[float] = []
        self.weights: list[float] = []

    def picture(self, picture: Picture) -> None:
        self.pictures.append(picture)

    def signals(self, signals: Any, weights: torch.Tensor, state: Any) -> None:
        self.times += signals.time.tolist()
        self.weights.append(float(weights[0, 0]))


def test_every_frame_goes_through_once_and_is_reported() -> None:
    reported: list[int] = []
    notes = Notes()
    result = run_model(StubModel(), Count(23), pictures_per_second=2, watchers=(notes,), report=reported.append)
    assert (result.model.name, result.source.name, result.frames, result.interrupted) == ("stub", "count", 23, False)
    assert result.simulated_seconds == pytest.approx(2.3)
    assert sum(reported) == 23
    assert notes.times == pytest.approx([n / 10 for n in range(23)])
    assert notes.weights[-1] == result.final_weights[0, 0] == 23
    assert result.outputs.times.tolist() == pytest.approx(notes.times)
    assert result.outputs.samples[:, 0].tolist() == list(range(23))


def test_pictures_come_at_their_rate_with_the_frame() -> None:
    notes = Notes()
    run_model(StubModel(), Count(23), pictures_per_second=2, watchers=(notes,))
    assert [picture.time for picture in notes.pictures] == pytest.approx([0.4, 0.9, 1.4, 1.9])
    for picture, number in zip(notes.pictures, (4, 9, 14, 19), strict=True):
        assert (picture.frame == number).all()
        assert picture.frame.shape == (16, 16, 3)
        assert picture.enhanced is None


def test_ctrl_c_keeps_what_was_computed() -> None:
    result = run_model(StubModel(), Count(100, broken=40), pictures_per_second=1)
    assert result.interrupted
    assert result.frames == 40
    assert result.objects[0].place == (39.0, 4.0)
    with pytest.raises(KeyboardInterrupt):
        run_model(StubModel(), Count(100, broken=0))


def test_outputs_that_are_no_numbers_end_the_run_at_the_last_that_were() -> None:
    result = run_model(StubModel(breaks=20), Count(100), pictures_per_second=1)
    assert (result.verdict, result.objects) == ("alternating", [])
    assert result.frames == int(result.state.frames) == 20


def test_no_frame_and_one_frame_are_refused() -> None:
    with pytest.raises(InputError, match="no frames"):
        run_model(StubModel(), Count(0))
    with pytest.raises(InputError, match="one frame cannot show motion"):
        run_model(StubModel(), Count(1))
    # One more frame of a run that goes on is fine.
    assert run_model(StubModel(), Count(6), StubState(torch.tensor(5)), start=5).frames == 1


def run(wanted: Path, text: str, force: bool = False) -> Path:
    """A run that leaves one file; gives its folder."""
    folder = RunFolder(wanted, force)
    (folder.work / "objects.json").write_text(text)
    assert [path.name for path in folder.publish()] == ["objects.json"]
    return folder.final


def tree(folder: Path) -> dict[str, str]:
    return {str(path.relative_to(folder)): path.read_text() for path in folder.rglob("*") if path.is_file()}


def test_every_run_has_a_folder_of_its_own(tmp_path: Path) -> None:
    names = [run(tmp_path / "bars", str(number)).name for number in range(3)]
    assert names == ["bars", "bars-2", "bars-3"]
    assert tree(tmp_path) == {"bars/objects.json": "0", "bars-2/objects.json": "1", "bars-3/objects.json": "2"}


def test_runs_at_the_same_time_do_not_share_a_folder(tmp_path: Path) -> None:
    (tmp_path / "bars").mkdir()  # an empty folder is as good as none
    folders = [RunFolder(tmp_path / "bars") for _ in range(3)]
    for number, folder in enumerate(folders):
        (folder.work / "objects.json").write_text(str(number))
    folders[1].discard()
    folders[2].publish()
    folders[0].publish()
    assert tree(tmp_path) == {"bars/objects.json": "0", "bars-3/objects.json": "2"}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bars", "bars-3"]


def test_force_takes_the_folder_and_leaves_other_files(tmp_path: Path) -> None:
    run(tmp_path / "bars", "old")
    (tmp_path / "bars" / "notes.txt").write_text("mine")
    assert run(tmp_path / "bars", "new", force=True) == tmp_path / "bars"
    assert tree(tmp_path) == {"bars/objects.json": "new", "bars/notes.txt": "mine"}
