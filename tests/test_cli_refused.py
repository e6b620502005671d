"""What the command line says about input that it cannot use: one line, and code 2."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.command_line import refused


def test_a_source_that_was_probably_meant(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(["bind", "two-bar", "--out", str(tmp_path)], capsys, "did you mean two-bars?")
    mistyped = str(clip.with_name("bras.avi"))
    refused(["bind", mistyped, "--out", str(tmp_path)], capsys, mistyped, f"did you mean {clip}?")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["{clip}", "--gamma", "1"], ["--gamma is an option of published, scale-free; the model is foreground"]),
        (["{clip}", "--rule", "hebbian"], ["--rule is an option of published; the model is foreground"]),
        (["{clip}", "--fit", "stretch"], ["--fit", "published", "the model is foreground"]),
        (["two-bars", "--model", "scale-free", "--order", "printed"], ["--order is an option of published"]),
        (["{clip}", "--model", "video"], ["the model video is gone; foreground does its job"]),
        (["two-bars", "--model", "cubist"], ["model", "published", "foreground", "cubist"]),
        (["two-bars", "--rule", "scale-free"], ["--model scale-free"]),
        (["{clip}", "--front-end", "on"], ["--model foreground"]),
        (["{clip}", "--front-end", "off"], ["--model published"]),
    ],
)
def test_what_a_model_does_not_know_is_refused(
    arguments: list[str], words: list[str], clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [argument.format(clip=clip) for argument in arguments]
    refused(["bind", *given, "--out", str(tmp_path / "out")], capsys, *words)
    assert not (tmp_path / "out").exists()
