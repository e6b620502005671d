"""Completion in bash: `eval "$(ndtorch --completion)"` in ~/.bashrc; in zsh after `bashcompinit`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

SCRIPT = """_ndtorch() {{
    local cur="${{COMP_WORDS[COMP_CWORD]}}" words=""
    if [ "$COMP_CWORD" -eq 1 ]; then
        COMPREPLY=($(compgen -W "{commands}" -- "$cur"))
        return
    fi
    case "${{COMP_WORDS[1]}}" in
{cases}
    esac
    if [ "${{cur#-}}" != "$cur" ]; then
        COMPREPLY=($(compgen -W "$words" -- "$cur"))
    else
        COMPREPLY=($(compgen -f -- "$cur"))
    fi
}}
complete -o filenames -F _ndtorch ndtorch
"""


def completion(flags: Mapping[str, Sequence[str]]) -> str:
    """A script for bash that completes commands, their flags, and files.

    Args:
        flags: of every command.
    """
    cases = "\n".join(f'        {name}) words="{" ".join(words)}" ;;' for name, words in flags.items())
    return SCRIPT.format(commands=" ".join(flags), cases=cases)
