"""The list of claims, their verdicts, and the parts beyond the papers."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
import torch

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch.utils.packages import files_of
from ndtorch_train.reproduce import beyond_paper
from ndtorch_train.reproduce.claims import CLAIMS, chosen
from ndtorch_train.reproduce.experiment import Claim, Context, Outcome, ResultCache, run_claim, verdict_of, with_better
from ndtorch_train.reproduce.page import BEGIN, END, Entry, as_json, markdown, not_run, page, tally
from ndtorch_train.reproduce.video import ParkingLot


def test_every_claim_of_the_list_is_there() -> None:
    ids = [claim.id for claim in CLAIMS]
    assert ids == [f"A{k}" for k in range(1, 10)] + [f"B{k}" for k in range(1, 11)] + [f"C{k}" for k in range(1, 10)]
    for claim in CLAIMS:
        assert all(files_of(use) for use in claim.uses), claim.id
        assert claim.printed
        assert claim.tolerance


def test_the_same_claim_is_tried_with_better_parts() -> None:
    """What does not hold as published has a second try within the same tolerance."""
    tried = {claim.id: claim.better for claim in CLAIMS if claim.better is not None}
    assert set(tried) == {"A4", "A8", "B7", "B9", "B10", "C8", "C9"}
    for claim in CLAIMS:
        if claim.better is not None:
            again = claim.better
            assert (again.id, again.tolerance, again.text) == (f"{claim.id}+", claim.tolerance, claim.text)
            assert again.parts
            assert again.better is None
            assert all(files_of(use) for use in again.uses), again.id


def test_claims_by_name() -> None:
    assert [claim.id for claim in chosen(["c5", "A1"])] == ["A1", "C5"]
    assert len(chosen([])) == len(CLAIMS)
    with pytest.raises(InputError, match=r"unknown claim 'B55'; claims are A1, .*; did you mean B5"):
        chosen(["B55"])


def test_verdicts() -> None:
    assert verdict_of(True, True) == "holds"
    assert verdict_of(True, False) == "partly"
    assert verdict_of(False, False) == "does not hold"


def test_better_parts_stand_behind_what_they_better() -> None:
    assert [claim.id for claim in with_better(chosen(["B5", "B7", "C9"]))] == ["B5", "B7", "B7+", "C9", "C9+"]


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


def entries() -> list[Entry]:
    """A claim that holds, one that holds with better parts only, and one whose better parts were not tried."""
    holds, fails, slow = chosen(["A3", "B7", "C8"])
    assert fails.better is not None
    assert slow.better is not None
    with_them = Entry(fails.better, Outcome("80 of 90", "holds", "Because."), {"seconds": 1}, [], None)
    return [
        Entry(holds, Outcome("yes", "holds", ""), {}, [], None),
        Entry(fails, Outcome("31 of 90", "partly", "Too few."), {}, [], None, with_them),
        Entry(slow, Outcome("one", "does not hold", ""), {}, [], None, not_run(slow.better)),
    ]


def test_the_second_verdict_is_counted_only_where_it_was_tried() -> None:
    words = "1 claim holds, 1 holds in part, 1 does not hold; with the better parts 2 claims hold, 1 does not hold"
    assert tally(entries()) == words
    assert tally(entries()[:1]) == "1 claim holds"


def test_both_verdicts_stand_in_table_json_and_page() -> None:
    (_, row, _) = [
        line for line in markdown(entries(), False, "x").splitlines() if line[:4] in ("| A3", "| B7", "| C8")
    ]
    assert "| **partly** | Too few. | holds, the scale-free model: 80 of 90. Because. |" in row
    first, second, _ = map(as_json, entries())
    assert first["better"] is None
    assert (second["verdict"], second["better"]["verdict"]) == ("partly", "holds")
    assert second["better"]["parts"] == "the scale-free model"
    assert "tolerance" not in second["better"]
    text = page(entries(), False, "x")
    assert "with the better parts" in text
    assert "the scale-free model: 80 of 90. Because." in text


def test_exactly_means_each_color_once() -> None:
    found = [["green", "red"], ["red"], ["red", "red"], ["red", "green", "blue"]]
    assert beyond_paper.exactly(found, ["red", "green"]) == [True, False, False, False]


def test_colors_at_are_those_of_the_moment() -> None:
    """A red object alone, and then a blue one in its place."""
    time = torch.arange(1200) / 100
    light = 0.5 + 0.4 * torch.sin(6.0 * time)
    red = torch.tensor([0, 1.0, 0, 0, 1.0, 0.2, 0.2, 1.0, 0.1, 0.1])
    blue = torch.tensor([1.0, 0, 0, 0, 0.2, 1.0, 0.2, 0.1, 0.1, 1.0])
    sums = light[:, None] * torch.where(time[:, None] < 6, red, blue)
    first, last = beyond_paper.colors_at(sums[None], [600, 1200])
    assert (first, last) == ([["red"]], [["blue"]])


@pytest.fixture
def context(tmp_path: Path) -> Context:
    return Context(tmp_path, tmp_path, True, lambda share: None)


def test_without_a_clip_the_road_is_left_out(context: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    class Still(ParkingLot):
        def __init__(self, settle: float, seconds: float, seed: int) -> None:
            super().__init__(settle, 0.2 - settle, seed)

    monkeypatch.setattr(beyond_paper, "ParkingLot", Still)
    outcome = beyond_paper.one_object(context, 0, "")
    assert outcome.ours == "stand-in: 0 (none)"
    assert outcome.verdict == "does not hold"
    assert "No road clip given" in outcome.why


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Experiments run here instead of in processes; returns the names of those that ran."""
    ran: list[str] = []

    def events(function: Any, tasks: Any, jobs: int) -> Any:
        for n, task in enumerate(tasks):
            ran.append(task[0].id)
            function(task, lambda share: None)
            yield "done", n, None

    monkeypatch.setattr("ndtorch_train.reproduce.command.run_tasks", events)
    return ran


def test_ctrl_c_tells_how_many_results_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stopped(function: Any, tasks: Any, jobs: int) -> Any:
        function(next(task for task in tasks if task[0].id == "A3"), lambda share: None)
        raise KeyboardInterrupt
        yield

    monkeypatch.setattr("ndtorch_train.reproduce.command.run_tasks", stopped)
    assert main(["reproduce", "A3", "C1", "--out", str(tmp_path / "out"), "--jobs", "1"]) == 130
    assert "keeps 1 of 2 results, and the same command goes on with the others\n" in capsys.readouterr().err


def test_results_are_kept_until_code_or_parameters_change(
    tmp_path: Path, in_process: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    table = tmp_path / "README.md"
    table.write_text(f"before\n{BEGIN}\nstale table\n{END}\nafter\n")
    command = ["reproduce", "A3", "--out", str(out), "--jobs", "1"]
    assert main([*command, "--table", str(table)]) == 0
    assert main(command) == 0
    assert in_process == ["A3"]
    data = json.loads((out / "claims.json").read_text())["claims"]
    assert data[0]["verdict"] == "holds"
    assert data[0]["numbers"]["slope"] == pytest.approx(0.1212, abs=5e-5)
    page = (out / "report.html").read_text()
    assert "0.1212°/px" in page
    # It opens offline: nothing is loaded from anywhere.
    assert '<img src="data:image/' in page
    assert re.findall(r"(?:src|href)=\"(?!data:|#)", page) == []
    text = table.read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "stale table" not in text
    assert "| A3 | linear angle of a pixel" in text
    assert {p.name for p in (out / "figures").iterdir()} == {"A-pixel-angle.svg", "A-pixel-angle.png"}

    place = ResultCache(out / "cache").place(chosen(["A3"])[0], False)
    result = json.loads((place / "result.json").read_text())
    (place / "result.json").write_text(json.dumps(result | {"code": "of yesterday"}))
    assert main(command) == 0
    assert in_process == ["A3", "A3"]
    assert "results of A3 are of other code and not used" in capsys.readouterr().err
    (place / "A-pixel-angle.svg").unlink()
    assert main(command) == 0
    assert in_process == ["A3"] * 3
    before = (out / "report.html").read_bytes()
    assert main([*command, "--fresh"]) == 0
    assert in_process == ["A3"] * 4
    assert (tmp_path / "out-2" / "report.html").is_file()
    assert (out / "report.html").read_bytes() == before


def test_an_experiment_that_breaks_leaves_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def events(function: Any, tasks: Any, jobs: int) -> Any:
        for n, task in enumerate(tasks):
            if task[0].id == "B3":
                yield "again", n, "SIGKILL"
                yield "failed", n, "its worker died 3 times, at last with exit code -9"
            else:
                function(task, lambda share: None)
                yield "done", n, None

    monkeypatch.setattr("ndtorch_train.reproduce.command.run_tasks", events)
    assert main(["reproduce", "A3", "B3", "--out", str(tmp_path), "--jobs", "1"]) == 1
    assert [c["id"] for c in json.loads((tmp_path / "claims.json").read_text())["claims"]] == ["A3"]
    assert "error: B3 could not be tried: its worker died 3 times" in capsys.readouterr().err


HOLD = {"A1", "A2", "A3", "B2", "B3", "B4", "B5", "B6", "C1", "C2", "C4", "C7"}
"""Claims that hold, and of which a quick run shows it."""

FAIL = {"A4", "B1", "B10", "C6", "C8", "C9"}
"""Claims that do not hold or hold in part, and that are shown so."""

CHEAP = (
    "B1",
    *(claim.id for claim in CLAIMS if claim.quick is not None and claim.seconds[1] <= 1 and claim.id != "A7"),
)
"""Claims that take a second or so, and one that is known not to hold; tests/robot/test_drive.py drives for A7."""


@pytest.mark.slow
def test_a_quick_run_of_cheap_claims(tmp_path: Path, in_process: list[str]) -> None:
    assert len(CHEAP) > 3
    assert HOLD.intersection(CHEAP)
    assert FAIL.intersection(CHEAP)
    quick_run(CHEAP, tmp_path)
    assert sorted(in_process) == sorted(CHEAP)


@pytest.mark.long
def test_a_quick_run_of_everything(tmp_path: Path) -> None:
    """All claims in their quick form; those known to fail are shown as failing."""
    claims = quick_run((), tmp_path)
    assert set(claims) == {claim.id for claim in CLAIMS} >= HOLD | FAIL
    assert claims["B8"]["verdict"] == "not run in quick"


def quick_run(names: Sequence[str], out: Path) -> dict[str, dict[str, Any]]:
    """Run claims, all by default, and judge those of which it is known how they come out; gives them by name."""
    assert main(["reproduce", *names, "--quick", "--out", str(out), "--jobs", "2"]) == 0
    claims = {c["id"]: c for c in json.loads((out / "claims.json").read_text())["claims"]}
    for name in HOLD & set(claims):
        assert claims[name]["verdict"] == "holds", claims[name]
    for name in FAIL & set(claims):
        assert claims[name]["verdict"] in ("partly", "does not hold"), claims[name]
    assert all((out / "figures" / f"{f}.svg").is_file() for c in claims.values() for f in c["figures"])
    return claims
