"""The command that scores."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ndtorch.commands import main


def test_the_command_writes_a_leaderboard(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["score", "--rules", "scale-free", "greedy", "--scenes", "3", "--seconds", "2", "--out", str(tmp_path)]
    assert main([*arguments, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [(row["method"], row["seconds"]) for row in rows] == [("scale-free", 2), ("greedy", 2)]
    assert "| scale-free | yes | 2 |" in (tmp_path / "leaderboard.md").read_text(encoding="utf-8")
    assert len((tmp_path / "leaderboard.csv").read_text(encoding="utf-8").splitlines()) == 3
    assert (tmp_path / "leaderboard.png").stat().st_size > 5000
    assert "Split tune" in (tmp_path / "leaderboard.md").read_text(encoding="utf-8")


def test_a_score_leaves_the_last_one_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["score", "--scenes", "0", "--out", str(tmp_path / "s")]
    assert main(arguments) == 0
    before = (tmp_path / "s" / "leaderboard.md").read_bytes()
    assert main(arguments) == 0
    assert f"written  {tmp_path / 's-2'}: leaderboard.csv, leaderboard.md" in capsys.readouterr().out
    assert (tmp_path / "s" / "leaderboard.md").read_bytes() == before
    assert main([*arguments, "--force"]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["s", "s-2"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--rules", "oja"], ["rules", "published"]),
        (["--seconds", "1000"], ["seconds", "100"]),
        (["--stress", "-1"], ["stress", "-1"]),
        (["--scenes", "2000000"], ["scenes", "1000000"]),
    ],
)
def test_bad_options_are_one_line(options: list[str], words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["score", *options]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert all(word in error for word in words)
