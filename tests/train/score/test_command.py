"""The command that scores."""

from __future__ import annotations

from pathlib import Path

import pytest

from ndtorch.commands import main


def test_the_command_writes_a_leaderboard(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["score", "--rules", "scale-free", "greedy", "--scenes", "3", "--seconds", "2", "--out", str(tmp_path)]
    assert main(arguments) == 0
    assert "| scale-free | yes | 2 |" in (tmp_path / "leaderboard.md").read_text(encoding="utf-8")
    assert len((tmp_path / "leaderboard.csv").read_text(encoding="utf-8").splitlines()) == 3
    assert (tmp_path / "leaderboard.png").stat().st_size > 5000
    assert "Split tune" in capsys.readouterr().out


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
