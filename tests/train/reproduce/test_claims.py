"""The list of claims, their verdicts, and the parts beyond the papers."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.utils.packages import files_of
from ndtorch_train.reproduce import beyond_paper
from ndtorch_train.reproduce.claims import CLAIMS, chosen
from ndtorch_train.reproduce.experiment import Claim, Context, Outcome, ResultCache, run_claim, verdict_of, with_better
from ndtorch_train.reproduce.page import Entry, as_json, markdown, not_run, page, tally
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
