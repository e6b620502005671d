"""What `make fuzz` is made of: every seed can be read, some damaged files, and those that were findings once."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from ndtorch.errors import InputError
from tests.fuzz import worker
from tests.fuzz.corpus import BARN, MAKERS, corpus
from tests.fuzz.targets import TARGETS

pytestmark = pytest.mark.filterwarnings("default")

QUICK = sorted(set(TARGETS) - {"replay", "video"})


def test_every_reader_has_a_corpus_of_small_files() -> None:
    assert set(MAKERS) == set(TARGETS) - {"model"}
    assert all(target.seeds() for target in TARGETS.values())
    assert max(path.stat().st_size for name in MAKERS for path in corpus(name).rglob("*")) < 50_000


@pytest.mark.parametrize("name", QUICK)
def test_seeds_are_read_and_some_damaged_files_do_no_harm(name: str, tmp_path: Path) -> None:
    target = TARGETS[name]
    for seed in target.seeds():
        target.read(seed)
    found = []
    for number in range(6):
        folder = tmp_path / str(number)
        folder.mkdir()
        outcome, line = worker.attempt(target, 1, number, folder)
        found += [f"input {number}: {line}"] * (outcome == worker.FOUND)
    assert not found


@pytest.mark.long
@pytest.mark.parametrize("name", TARGETS)
def test_many_damaged_files(name: str, tmp_path: Path) -> None:
    mine = worker.Worker(TARGETS[name], 2, tmp_path)
    mine.work(5.0)
    assert mine.tried > 0
    assert not mine.findings


DEEP = "[" * 4000


def car(text: str) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        path.write_text(f"x = {text}\n")

    return make


def barn(path: Path) -> None:
    path.write_text(json.dumps(BARN | {"radius_m": 10**400}))


def configuration(path: Path) -> None:
    from ndtorch_robot.recording.streams import crc_of
    from tests.robot.support.recorded import rewrite

    rewrite(path, lambda topic, number, data: data, {"configuration": "[1]", "crc": crc_of("[1]")})


def truth(path: Path) -> None:
    (path / "gt.txt").write_text("1,nan,2,3,5,4,1\n")


REFUSED = {
    "toml that is nested too deep": ("car", "sim.toml", car(DEEP)),
    "a number of 5000 digits": ("car", "sim.toml", car("9" * 5000)),
    "barn that is nested too deep": ("barn", "worlds.json", lambda path: path.write_text(DEEP)),
    "a radius of 400 digits": ("barn", "worlds.json", barn),
    "a configuration that is none": ("recording", "strips.mcap", configuration),
    "an identity that is no number": ("truth", "clip", truth),
}


@pytest.mark.parametrize("name", REFUSED)
def test_findings_are_refused_now(name: str, tmp_path: Path) -> None:
    reader, seed, make = REFUSED[name]
    path = copied(reader, seed, tmp_path)
    make(path)
    with pytest.raises(InputError) as error:
        TARGETS[reader].read(path)
    assert "\n" not in str(error.value)


def copied(reader: str, seed: str, folder: Path) -> Path:
    source = corpus(reader) / seed
    copy = folder / seed
    (shutil.copytree if source.is_dir() else shutil.copy)(source, copy)
    return copy
