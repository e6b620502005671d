"""Whole runs against those that were recorded in `runs.json`, by what matters in them.

A change that means to change these numbers writes them anew with `python -m tests.golden` and says so.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.golden.runs import EVERY, RUNS, Kept, Numbers, replayed, unpack

pytestmark = pytest.mark.slow

GOLDEN: dict[str, Kept] = json.loads((Path(__file__).parent / "runs.json").read_text(encoding="utf-8"))


def named(kind: str) -> list[str]:
    return [name for name in GOLDEN if name.startswith(f"{kind}/")]


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
    closely(found["map"], wanted["map"], 0.5)
    assert found["map_scores"] == pytest.approx(wanted["map_scores"], abs=0.02)


def every_mode(kept: Kept) -> Numbers:
    """The mode of every frame."""
    return np.repeat(*np.array(kept["modes"]).T)


@pytest.mark.parametrize("name", named("drive"))
def test_drive(name: str) -> None:
    """See `drives_alike`."""
    drives_alike(RUNS[name](GOLDEN[name]), GOLDEN[name])


def localises_alike(found: Kept, wanted: Kept) -> None:
    """As `drives_alike`, and poses within 3 cm and a third of a degree: a match that just counts moves the car so."""
    drives_alike(found, wanted)
    closely(np.array(found["pose_errors"]) / (0.03, 0.3), np.array(wanted["pose_errors"]) / (0.03, 0.3), 1.0)
    assert found["found"] == pytest.approx(wanted["found"], abs=0.1)


def test_localise() -> None:
    """See `localises_alike`; of loop closures, one in ten may be another."""
    name = "localise/office"
    wanted, found = GOLDEN[name], RUNS[name](GOLDEN[name])
    localises_alike(found, wanted)
    assert found["submaps"] == wanted["submaps"]
    assert found["closures"] == pytest.approx(wanted["closures"], rel=0.1)


def test_known_map() -> None:
    """See `localises_alike`."""
    wanted = GOLDEN["localise/known_map"]
    found = RUNS["localise/known_map"](wanted)
    for part in ("mapped", "found"):
        localises_alike(found[part], wanted[part])


def test_replay() -> None:
    """From frames kept to the bit one processor computes the same to the bit."""
    assert replayed() == {"steps": 90, "same": 90}


@pytest.mark.parametrize("name", ["drive/published/room/0", "drive/ranging/chairs/1", "drive/goal/office/0"])
def test_drive_by_itself(name: str) -> None:
    """Without the recorded commands rounding grows: for 5 s the car stays within 2 cm of its path."""
    until = 5 * 30 // EVERY
    closely(np.array(RUNS[name](None)["poses"])[:until], np.array(GOLDEN[name]["poses"])[:until], 0.02)
