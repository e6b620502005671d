"""Whole runs against those that were recorded in `runs.json`, by what matters in them.

A change that means to change these numbers writes them anew with `python -m tests.golden` and says so.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.golden.runs import ARENAS, EVERY, RATE, RUNS, Kept, Numbers, localised, replayed, unpack

pytestmark = pytest.mark.slow

GOLDEN: dict[str, Kept] = json.loads((Path(__file__).parent / "runs.json").read_text(encoding="utf-8"))


SELDOM = ("/three-bars", "foreground/two-bars", "/1", *(f"/{arena}/0" for arena in ARENAS if arena != "office"))
"""Ends of the names of runs that only `make test-long` compares."""


def named(kind: str) -> list[Any]:
    names = [name for name in GOLDEN if name.startswith(f"{kind}/")]
    return [pytest.param(name, marks=pytest.mark.long) if name.endswith(SELDOM) else name for name in names]


def test_every_run_is_recorded() -> None:
    assert list(GOLDEN) == list(RUNS)


def closely(found: Any, wanted: Any, tolerance: float) -> None:
    """Both have the same shape, and no number differs by more."""
    np.testing.assert_allclose(np.asarray(found, float), np.asarray(wanted, float), rtol=0, atol=tolerance)


def mostly(found: Any, wanted: Any, tolerance: float, share: float) -> None:
    """Both have the same shape, and at most this share of the rows differs by more."""
    found, wanted = np.asarray(found, float), np.asarray(wanted, float)
    assert found.shape == wanted.shape
    off = np.abs(found - wanted) > tolerance
    assert off.reshape(len(off), -1).any(1).mean() <= share


@pytest.mark.parametrize("name", named("bind"))
def test_bind(name: str) -> None:
    """Features to .02, weights and outputs to .01: learning amplifies rounding. Boxes to a pixel. Times are equal."""
    wanted, found = GOLDEN[name], RUNS[name](None)
    assert found["verdict"] == wanted["verdict"]
    closely(found["weights"], wanted["weights"], 0.01)
    closely(found["outputs"], wanted["outputs"], 0.01)
    assert len(found["objects"]) == len(wanted["objects"])
    for thing, before in zip(found["objects"], wanted["objects"], strict=True):
        for key in ("neuron", "track", "direction", "color"):
            assert thing[key] == before[key], key
        assert thing["features"] == pytest.approx(before["features"], abs=0.02)
        assert thing["seen"] == before["seen"]
        closely(thing["places"], before["places"], 1.0)
        closely(thing["boxes"], before["boxes"], 1.0)


def drives_alike(found: Kept, wanted: Kept) -> None:
    """A drive with the recorded commands.

    The car drives the same to the millimetre. In one of fifty frames a threshold that is just met may give another
    command or mode, and one in ten half seconds another range.
    """
    closely(found["poses"], wanted["poses"], 0.002)
    closely(found["end"], wanted["end"], 0.002)
    for key in ("collisions", "stops", "distance", "free_area"):
        assert found[key] == pytest.approx(wanted[key], abs=0.02), key
    mostly(unpack(found["wanted"]), unpack(wanted["wanted"]), 0.01, 0.02)
    mostly(every_mode(found), every_mode(wanted), 0, 0.02)
    mostly(found["sides"], wanted["sides"], 0.02, 0.02)
    mostly(found["ranges"], wanted["ranges"], 0.05, 0.1)


def maps_alike(found: Kept, wanted: Kept) -> None:
    """No square metre holds half a percent of the map more or less."""
    closely(found["map"], wanted["map"], 0.5)
    assert found["map_scores"] == pytest.approx(wanted["map_scores"], abs=0.02)


def every_mode(kept: Kept) -> Numbers:
    """The mode of every frame."""
    return np.repeat(*np.array(kept["modes"]).T)


@pytest.mark.parametrize("name", named("drive"))
def test_drive(name: str) -> None:
    """See `drives_alike` and `maps_alike`."""
    found = RUNS[name](GOLDEN[name])
    drives_alike(found, GOLDEN[name])
    maps_alike(found, GOLDEN[name])


def poses_alike(found: Kept, wanted: Kept, until: float) -> None:
    """The localiser is as far off to 2 mm and .02 degrees until then, in s, and to 3 cm and .6 degrees later."""
    off = np.abs(np.array(found["pose_errors"]) - np.array(wanted["pose_errors"])[: len(found["pose_errors"])])
    seconds = 2 * np.arange(len(off))
    assert (off[seconds <= until] <= (0.002, 0.02)).all()
    assert (off <= (0.03, 0.6)).all()


def test_the_beginning_of_localise() -> None:
    """See `test_localise`."""
    golden = GOLDEN["localise/office"]
    found = localised(golden, 30.0)
    mostly(unpack(found["wanted"]), unpack(golden["wanted"])[:900], 0.01, 0.02)
    poses_alike(found, golden, 30.0)
    assert found["submaps"] > 1


@pytest.mark.long
def test_localise() -> None:
    """Ten minutes amplify rounding: a patch that visual odometry just matches, or not, a turn that begins a frame
    earlier. So commands are compared for a minute and a half; later one loop closure in seven may be missing, and the
    map is right to a tenth.
    """
    wanted, found = GOLDEN["localise/office"], RUNS["localise/office"](GOLDEN["localise/office"])
    mostly(unpack(found["wanted"])[:2700], unpack(wanted["wanted"])[:2700], 0.01, 0.02)
    poses_alike(found, wanted, 100.0)
    assert found["submaps"] == wanted["submaps"]
    assert found["closures"] == pytest.approx(wanted["closures"], rel=1 / 7)
    closely(found["map"], wanted["map"], 2.5)
    for key in ("precision", "recall", "surfaces"):
        assert found["map_scores"][key] == pytest.approx(wanted["map_scores"][key], abs=0.1), key


def test_known_map() -> None:
    """In a minute no rounding grows; the car finds itself at the same time."""
    kept = GOLDEN["localise/known_map"]
    every = RUNS["localise/known_map"](kept)
    for part in ("mapped", "found"):
        found, wanted = every[part], kept[part]
        drives_alike(found, wanted)
        maps_alike(found, wanted)
        poses_alike(found, wanted, 60.0)
        assert found["found"] == pytest.approx(wanted["found"], abs=0.1)
        assert (found["submaps"], found["closures"]) == (wanted["submaps"], wanted["closures"])


def test_replay() -> None:
    """From frames kept to the bit one processor computes the same to the bit."""
    assert replayed() == {"steps": 90, "same": 90}


@pytest.mark.parametrize("name", ["drive/published/room/0", "drive/ranging/chairs/0", "drive/goal/office/0"])
def test_drive_by_itself(name: str) -> None:
    """Without the recorded commands rounding grows: for 5 s the car stays within 2 cm of its path."""
    found = RUNS[name](None, seconds=5.0)["poses"]
    assert len(found) == 5 * RATE // EVERY
    closely(found, GOLDEN[name]["poses"][: len(found)], 0.02)
