"""Where experiments work: what they leave behind when they are killed."""

from __future__ import annotations

import fcntl
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from ndtorch_train.reproduce.experiment import Claim, Context, Outcome, ResultCache, held, lock_folder, run_claim


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


def test_two_runs_of_one_claim_that_end_at_once_leave_one_whole_result(tmp_path: Path) -> None:
    ready = threading.Barrier(2)

    def tried(context: Context) -> Outcome:
        (context.folder / "kept.txt").write_text("1")
        ready.wait(60)
        return Outcome("0.1", "reproduced", "")

    claim = Claim("Z1", "[Z]", "text", "printed", "none", tried, {}, {}, (1.0, 1.0), ("ndtorch.errors",))
    for _ in range(20):
        with ThreadPoolExecutor(2) as pool:
            runs = [pool.submit(run_claim, claim, False, tmp_path, "code", lambda *_: None) for _ in range(2)]
            assert [run.result() for run in runs] == [None, None]
    place = ResultCache(tmp_path).place(claim, False)
    assert sorted(path.name for path in place.iterdir()) == ["kept.txt", "result.json"]
    assert list(tmp_path.glob("*.part-*")) == []
