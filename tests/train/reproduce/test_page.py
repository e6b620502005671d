"""What a reader gets."""

from __future__ import annotations

from ndtorch_train.reproduce.claims import chosen
from ndtorch_train.reproduce.experiment import Outcome
from ndtorch_train.reproduce.page import Entry, as_json, markdown, not_run, page, tally


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
