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
from ndtorch_train.reproduce.experiment import Outcome


def test_claims_by_name() -> None:
    assert [claim.id for claim in chosen(["c5", "A1"])] == ["A1", "C5"]
    assert len(chosen([])) == len(CLAIMS)
    with pytest.raises(InputError, match=r"unknown claim 'B55'; claims are A1, .*; did you mean B5"):
        chosen(["B55"])


@pytest.mark.parametrize(
    ("parts", "verdict"), [("TT", "holds"), ("TF", "partly"), ("FF", "does not hold"), ("F", "does not hold")]
)
def test_verdict_of_criteria(parts: str, verdict: str) -> None:
    assert Outcome("ours", "", {str(n): part == "T" for n, part in enumerate(parts)}).verdict == verdict


QUICK = {"B1": "partly"} | dict.fromkeys(("A1", "A2", "A3", "B4", "C2", "C4", "C7"), "holds")
"""Cheap claims and their verdicts."""


@pytest.mark.slow
def test_quick_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Verdicts, page, figures and table agree; a second run computes nothing anew."""
    out, table = tmp_path / "out", tmp_path / "README.md"
    table.write_text(f"before\n{BEGIN}\nstale table\n{END}\nafter\n")
    command = ["reproduce", *QUICK, "--quick", "--out", str(out), "--jobs", "1", "--table", str(table), "--json"]
    assert main(command) == 0
    claims = {claim["id"]: claim for claim in json.loads(capsys.readouterr().out)}
    assert {name: claim["verdict"] for name, claim in claims.items()} == QUICK
    assert claims["A3"]["numbers"]["slope"] == pytest.approx(0.1212, abs=5e-5)
    page = (out / "report.html").read_text()
    assert re.findall(r"(?:src|href)=\"(?!data:|#)", page) == [], "the page opens offline"
    for claim in claims.values():
        assert claim["ours"] in page.replace("&#39;", "'").replace("&gt;", ">")
        assert all((out / "figures" / f"{name}.svg").is_file() for name, *_ in claim["figures"])
    text = table.read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "stale" not in text
    assert "Of 8 claims 7 holds, 1 partly." in text
    assert re.findall(r"^\| ([ABC]\d)", text, re.MULTILINE) == sorted(QUICK)
    before = (out / "figures" / "C4-objects.png").stat().st_mtime_ns
    assert main(command) == 0
    assert (out / "figures" / "C4-objects.png").stat().st_mtime_ns == before
