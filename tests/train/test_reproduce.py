"""The claims of the papers: verdicts, pages, and a quick run of those that take a second."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch_train.reproduce.claims import CLAIMS, chosen
from ndtorch_train.reproduce.command import BEGIN, END
from ndtorch_train.reproduce.experiment import Context, judged


def test_claims_by_name() -> None:
    assert [claim.id for claim in chosen(["c5", "A1"])] == ["A1", "C5"]
    assert len(chosen([])) == len(CLAIMS) == 27
    with pytest.raises(InputError, match=r"unknown claim 'B55'; claims are A1, .*; did you mean B5"):
        chosen(["B55"])


@pytest.mark.parametrize(
    ("parts", "verdict"),
    [
        ((True, True), "holds"),
        ((True, False), "partly"),
        ((False, False), "does not hold"),
        ((False,), "does not hold"),
    ],
)
def test_verdict_of_parts(parts: tuple[bool, ...], verdict: str, tmp_path: Path) -> None:
    outcome = judged(Context(tmp_path, tmp_path, False), "ours", "", {str(n): part for n, part in enumerate(parts)}, {})
    assert outcome.verdict == verdict


QUICK = {"A3": "holds", "B1": "partly", "B4": "holds", "C2": "holds", "C7": "holds"}
"""Cheap claims and their verdicts."""


@pytest.mark.slow
def test_quick_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Verdicts, page, JSON, figures and table agree; a second run computes nothing anew."""
    out, table = tmp_path / "out", tmp_path / "README.md"
    table.write_text(f"before\n{BEGIN}\nstale table\n{END}\nafter\n")
    command = ["reproduce", *QUICK, "--quick", "--out", str(out), "--jobs", "1", "--table", str(table)]
    assert main(command) == 0
    claims = {claim["id"]: claim for claim in json.loads((out / "claims.json").read_text())["claims"]}
    assert {name: claim["verdict"] for name, claim in claims.items()} == QUICK
    assert claims["A3"]["numbers"]["slope"] == pytest.approx(0.1212, abs=5e-5)
    page = (out / "report.html").read_text()
    assert re.findall(r"(?:src|href)=\"(?!data:|#)", page) == [], "the page opens offline"
    for claim in claims.values():
        assert claim["ours"] in page.replace("&#39;", "'").replace("&gt;", ">")
        assert all((out / "figures" / f"{name}.svg").is_file() for name in claim["figures"])
    text = table.read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "stale" not in text
    assert [line.split(" | ")[0] for line in text.splitlines() if line[:3] in ("| A", "| B", "| C")] == [
        f"| {name}" for name in QUICK
    ]
    before = {path: path.stat().st_mtime_ns for path in out.glob("results/*/result.json")}
    assert main(command) == 0
    assert {path: path.stat().st_mtime_ns for path in out.glob("results/*/result.json")} == before


def test_failed_experiment_leaves_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def events(function: object, tasks: object, jobs: int) -> object:
        yield "failed", 0, "its worker died 3 times"

    monkeypatch.setattr("ndtorch_train.reproduce.command.run_tasks", events)
    assert main(["reproduce", "B3", "--out", str(tmp_path)]) == 1
    assert json.loads((tmp_path / "claims.json").read_text())["claims"] == []
    assert "error: B3 could not be tried: its worker died 3 times" in capsys.readouterr().err
