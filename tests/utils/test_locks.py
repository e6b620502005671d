"""Two that want one file: the second waits, says so, and goes on when the first is done."""

from __future__ import annotations

import fcntl
import threading
from pathlib import Path

import pytest

from ndtorch.utils.files import hold


def test_whoever_waits_is_told_once_and_goes_on_when_the_other_lets_go(tmp_path: Path) -> None:
    path, told, held = tmp_path / "lock", threading.Semaphore(0), threading.Event()

    def second() -> None:
        with path.open("w") as file:
            hold(file, told.release, patience=0.1)
            held.set()

    with path.open("w") as first:
        fcntl.flock(first, fcntl.LOCK_EX)
        thread = threading.Thread(target=second)
        thread.start()
        assert told.acquire(timeout=60)
        assert not held.is_set()
    thread.join(60)
    assert held.is_set()
    assert not told.acquire(blocking=False)


@pytest.mark.parametrize("patience", [0.0, 5.0])
def test_what_nobody_holds_is_held_at_once_and_nothing_is_said(tmp_path: Path, patience: float) -> None:
    path, said = tmp_path / "lock", []
    with path.open("w") as file, path.open("w") as other:
        hold(file, lambda: said.append("waits"), patience)
        with pytest.raises(BlockingIOError):
            fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
    assert said == []
