"""What bash completes after `eval "$(ndtorch --completion)"`."""

from __future__ import annotations

import shutil
import subprocess

import pytest

from ndtorch.commands import main


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_commands_and_flags_are_completed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--completion"]) == 0
    script = capsys.readouterr().out

    def completed(*words: str) -> list[str]:
        typed = " ".join(f"'{word}'" for word in words)
        ask = f'COMP_WORDS=({typed}); COMP_CWORD={len(words) - 1}; _ndtorch; echo "${{COMPREPLY[@]}}"'
        done = subprocess.run(["bash", "-c", script + ask], capture_output=True, text=True, check=True)
        return done.stdout.split()

    assert completed("ndtorch", "bi") == ["bind"]
    assert {"bind", "drive", "reproduce"} <= set(completed("ndtorch", ""))
    assert completed("ndtorch", "drive", "--are") == ["--arena"]
    assert completed("ndtorch", "bind", "two-bars", "--mod") == ["--model"]
    assert completed("ndtorch", "bind", "--arena") == []
