"""Completion in a shell: a script that `ndtorch --completion SHELL` prints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

BASH = """_ndtorch() {{
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

# `words`, `CURRENT` and `PREFIX` are zsh's own.
ZSH = """_ndtorch() {{
    local flags=""
    if (( CURRENT == 2 )); then
        compadd -- {commands}
        return
    fi
    case "$words[2]" in
{cases}
    esac
    if [[ "$PREFIX" == -* ]]; then
        compadd -- ${{=flags}}
    else
        _files
    fi
}}
compdef _ndtorch ndtorch
"""

FISH = """complete -c ndtorch -e
complete -c ndtorch -n __fish_use_subcommand -f -a "{commands}"
{cases}
"""

SHELLS = {
    "bash": (BASH, '        {name}) words="{flags}" ;;'),
    "zsh": (ZSH, '        {name}) flags="{flags}" ;;'),
    "fish": (FISH, 'complete -c ndtorch -n "__fish_seen_subcommand_from {name}" -a "{flags}"'),
}
"""The script of each shell, and what it says of one command."""


def completion(shell: str, flags: Mapping[str, Sequence[str]]) -> str:
    """A script for a shell that completes commands, their flags, and files."""
    script, case = SHELLS[shell]
    cases = "\n".join(case.format(name=name, flags=" ".join(words)) for name, words in flags.items())
    return script.format(commands=" ".join(flags), cases=cases)
