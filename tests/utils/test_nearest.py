"""Names that are not known, everywhere a name can be given."""

from __future__ import annotations

from pathlib import Path

import pytest

from ndtorch.cli.commands import main


@pytest.mark.parametrize(
    ("words", "name"),
    [
        ("bindd two-bars", "bind"),
        ("bind two-barz", "two-bars"),
        ("bind two-bars --model publishd", "published"),
        ("bind two-bars --rule hebian", "hebbian"),
        ("render three-bras x.mp4", "three-bars"),
        ("drive --arena halway", "hallway"),
        ("drive --controller rangin", "ranging"),
        ("drive --odometry nosy", "noisy"),
        ("drive --feature-position moton", "motion"),
        ("evaluate --arenas rom", "room"),
        ("evaluate --controllers gaol", "goal"),
        ("run maxston8", "maxstone8"),
        ("check simm", "sim"),
        ("sweep bindin", "binding"),
        ("reproduce BB5", "B5"),
        ("benchmark scenes --methods scalefree", "scale-free"),
        ("benchmark foreground . --methods mog2-norfare", "mog2-norfair"),
        ("benchmark scenes --split tuen", "tune"),
        ("barn b.json --split al", "all"),
        ("bind two-bars --modle published", "--model"),
        ("evaluate --walls blnk", "blank"),
    ],
)
def test_every_closed_name_has_a_suggestion(
    words: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words.split()) == 2
    error = capsys.readouterr().err
    assert f"did you mean {name}?" in error, error
    assert error.startswith("error: ")
    assert error.count("\n") == 1
