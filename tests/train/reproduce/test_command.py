"""The command that reproduces the published results: its cache, its page, and what goes wrong."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from ndtorch.cli.commands import main
from ndtorch_train.reproduce.claims import CLAIMS, chosen
from ndtorch_train.reproduce.experiment import ResultCache
from ndtorch_train.reproduce.page import BEGIN, END


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
