"""What shells complete after they have read `ndtorch --completion SHELL`."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable

import pytest

from ndtorch.cli.commands import main


def shell_output(shell: str, script: str) -> list[str]:
    """The words that a script prints."""
    plain = {"bash": ["bash", "--norc"], "zsh": ["zsh", "-f"], "fish": ["fish", "--no-config"]}[shell]
    return subprocess.run([*plain, "-c", script], capture_output=True, text=True, check=True).stdout.split()


def in_bash(script: str, words: tuple[str, ...]) -> list[str]:
    typed = " ".join(f"'{word}'" for word in words)
    ask = f'COMP_WORDS=({typed}); COMP_CWORD={len(words) - 1}; _ndtorch; echo "${{COMPREPLY[@]}}"'
    return shell_output("bash", script + ask)


def in_zsh(script: str, words: tuple[str, ...]) -> list[str]:
    """By what zsh's own `compadd` is called with: it takes those that begin as the word does."""
    typed = " ".join(f"'{word}'" for word in words)
    ask = f"words=({typed}); CURRENT={len(words)}; PREFIX='{words[-1]}'; _ndtorch"
    before = 'compdef() { :; }; _files() { :; }; compadd() { shift; print -l -- "$@"; }\n'
    return [word for word in shell_output("zsh", before + script + ask) if word.startswith(words[-1])]


def in_fish(script: str, words: tuple[str, ...]) -> list[str]:
    return shell_output("fish", script + f"complete -C '{' '.join(words)}'")


@pytest.mark.parametrize(("shell", "ask"), [("bash", in_bash), ("zsh", in_zsh), ("fish", in_fish)])
def test_commands_and_flags_are_completed(
    shell: str, ask: Callable[[str, tuple[str, ...]], list[str]], capsys: pytest.CaptureFixture[str]
) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"needs {shell}")
    assert main(["--completion", shell]) == 0
    script = capsys.readouterr().out

    def completed(*words: str) -> list[str]:
        return ask(script, words)

    assert completed("ndtorch", "bi") == ["bind"]
    assert {"bind", "drive", "reproduce"} <= set(completed("ndtorch", ""))
    assert completed("ndtorch", "drive", "--are") == ["--arena"]
    assert completed("ndtorch", "bind", "two-bars", "--mod") == ["--model"]
    assert completed("ndtorch", "bind", "--arena") == []
