"""Where experiments work: what they leave behind when they are killed."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from ndtorch_train.reproduce.context import ResultCache, held, lock_folder


def test_what_killed_runs_left_is_removed_and_what_others_work_at_stays(tmp_path: Path) -> None:
    left, at_work, result = (tmp_path / name for name in ("A3-ab.part-1", "A3-ab.part-2", "A3-ab"))
    for folder in (left, at_work, result):
        folder.mkdir()
        (folder / "figure.png").touch()
    lock = lock_folder(at_work, fcntl.LOCK_EX)
    try:
        assert held(at_work)
        ResultCache(tmp_path).tidy()
    finally:
        os.close(lock)
    assert sorted(tmp_path.iterdir()) == [result, at_work]
    assert not held(at_work)
