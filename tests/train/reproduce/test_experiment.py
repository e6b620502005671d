"""Where experiments work: what they leave behind when they are killed, and two runs at once."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from ndtorch_train.reproduce.experiment import Claim, Context, Outcome, ResultCache, run_claim


def test_runs_of_one_claim_at_once_leave_one_whole_result_and_nothing_of_one_that_was_killed(tmp_path: Path) -> None:
    at_work: list[int] = []

    def tried(context: Context) -> Outcome:
        assert not at_work
        at_work.append(1)
        assert list(context.folder.iterdir()) == []
        (context.folder / "kept.txt").write_text("1")
        at_work.pop()
        return Outcome("0.1", "holds", "")

    claim = Claim("Z1", "[Z]", "text", "printed", "none", tried, {}, {}, (1.0, 1.0), ("ndtorch.errors",))
    place = ResultCache(tmp_path).place(claim, False)
    killed = place.with_name(f"{place.name}.part")
    killed.mkdir()
    (killed / "figure.png").touch()
    with ThreadPoolExecutor(2) as pool:
        runs = [pool.submit(run_claim, claim, False, tmp_path, "code", lambda *_: None) for _ in range(20)]
        assert [run.result() for run in runs] == 20 * [None]
    assert sorted(path.name for path in place.iterdir()) == ["kept.txt", "result.json"]
    assert not killed.exists()
