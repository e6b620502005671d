"""`ndtorch barn`: which worlds are driven, what is kept, and what comes of worlds that fail. Nothing is driven here."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from ndtorch.cli.commands import main
from ndtorch.utils import workers
from ndtorch_robot.barn.attempts import Attempt, Entry
from ndtorch_robot.commands import barn
from tests.robot.barn.test_barn import FILE as TWO_WORLDS

WORLDS = [{"world": n, "path_m": 10.0, "cylinders": [[2.0, 4.0]]} for n in (4, 5, 6)]
FILE = {**TWO_WORLDS, "worlds": WORLDS}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "worlds.json"
    path.write_text(json.dumps(FILE))
    return path


@pytest.fixture
def driven(monkeypatch: pytest.MonkeyPatch) -> list[Entry]:
    """The entries that would have been driven: the car touches something in world 6 and cannot be driven in world 5."""
    entries: list[Entry] = []

    def run(function: object, tasks: list[Entry], jobs: int) -> Iterator[workers.Event]:
        assert function is barn.drive_world
        for n, entry in enumerate(tasks):
            entries.append(entry)
            number = entry.world.number
            if number == 5 and entry.seed == 0:
                yield workers.Event("failed", n, "Traceback\n  in a file\nInputError: no OpenGL\n")
                continue
            hit = number == 6
            made = Attempt(number, not hit, hit, 20.0, 0.0 if hit else 0.25, [(0.0, 0.0), (0.0, 9.0)], 1.0, 0.4)
            yield workers.Event("done", n, made._asdict())

    monkeypatch.setattr(workers, "run_tasks", run)
    return entries


def test_what_is_finished_is_kept_and_not_driven_again(
    file: Path, driven: list[Entry], capsys: pytest.CaptureFixture[str]
) -> None:
    out = file.parent / "out"
    command = ["barn", str(file), "--out", str(out), "--json"]
    assert main(command) == barn.FAILED
    printed, told = capsys.readouterr()
    assert json.loads(printed) == {
        "worlds": 2,
        "success": 0.5,
        "collisions": 0.5,
        "score": 0.125,
        "median_time_s": 20.0,
    }
    assert "failed: world 5: InputError: no OpenGL" in told
    assert (out / "barn.csv").read_text().splitlines()[1:] == ["4,1,0,20.00,0.2500", "6,0,1,20.00,0.0000"]
    assert "1 of 3 worlds are missing" in (out / "barn.md").read_text()
    assert (out / "barn.png").stat().st_size > 1000
    assert main(command) == barn.FAILED
    assert [entry.world.number for entry in driven] == [4, 5, 6, 5]
    assert not out.with_name("out-2").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--worlds", "9"], "has no world 9 among those of --split all"),
        (["--split", "test", "--worlds", "4"], "has no world 4 among those of --split test"),
        (["--jobs", "-1"], "--jobs must be 1 or more, got -1"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_driven(
    arguments: list[str], message: str, file: Path, driven: list[Entry], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["barn", str(file), "--out", str(file.parent / "out"), *arguments]) == 2
    assert message in capsys.readouterr().err
    assert driven == []
    assert not (file.parent / "out").exists()


def test_ctrl_c_keeps_what_was_finished(
    file: Path, monkeypatch: pytest.MonkeyPatch, driven: list[Entry], capsys: pytest.CaptureFixture[str]
) -> None:
    whole = workers.run_tasks

    def cut(*arguments: object) -> Iterator[workers.Event]:
        yield next(iter(whole(*arguments)))
        raise KeyboardInterrupt

    monkeypatch.setattr(workers, "run_tasks", cut)
    out = file.parent / "out"
    assert main(["barn", str(file), "--out", str(out)]) == 130
    assert (out / "barn.csv").read_text().splitlines()[1:] == ["4,1,0,20.00,0.2500"]
    assert "2 of 3 worlds are missing" in capsys.readouterr().out
