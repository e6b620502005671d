"""Changes of C source: operators, numbers, and statements left out."""

from __future__ import annotations

import re

from tests.mutation.change import Change

SWAPS = {
    "<=": ("<", ">"),
    ">=": (">", "<"),
    "<": ("<=", ">="),
    ">": (">=", "<="),
    "==": ("!=",),
    "!=": ("==",),
    "&&": ("||",),
    "||": ("&&",),
    "++": ("--",),
    "--": ("++",),
    "+=": ("-=", "="),
    "-=": ("+=", "="),
    "|=": ("&=", "="),
    "&=": ("|=", "="),
    "+": ("-",),
    "-": ("+",),
    "*": ("/",),
    "/": ("*",),
    "%": ("*",),
    "<<": (">>",),
    ">>": ("<<",),
    "^": ("|",),
}
TOKEN = re.compile(r"->|<<=|>>=|<=|>=|==|!=|&&|\|\||\+\+|--|\+=|-=|\|=|&=|<<|>>|[-+*/%<>^]|\b(?:0x[0-9a-fA-F]+|\d+)\b")
QUIET = re.compile(
    r"/\*.*?\*/|//[^\n]*|^[ \t]*#[^\n]*|_Static_assert\(.*?\);|\"[^\"\n]*\"|'[^'\n]*'", re.DOTALL | re.MULTILINE
)
STATEMENT = re.compile(
    r"(?<=[{};])(\s*)((?:if \([^;{}]*\) )?(?!return|case|default|break|else|struct|u?int|const)[a-z][^;{}]*;)"
)


def places(file: str, text: str) -> list[list[Change]]:
    """Every place that can be changed, with its changes."""
    blanked = QUIET.sub(lambda found: re.sub(r"[^\n]", " ", found[0]), text)

    def at(start: int, end: int, new: str, kind: str) -> Change:
        return Change(file, text.count("\n", 0, start) + 1, start, end, new, kind)

    found = []
    for token in TOKEN.finditer(blanked):
        word, (start, end) = token[0], token.span()
        if word[0].isdigit():
            found.append([at(start, end, str(int(word, 0) + 1), "number")])
        elif word == "*" and (blanked[end] not in " " or blanked[start - 1] in "("):
            continue  # a pointer
        elif word in SWAPS:
            found.append([at(start, end, new, "operator") for new in SWAPS[word]])
    for statement in STATEMENT.finditer(blanked):
        if "for (" not in statement[0]:
            found.append([at(statement.start(2), statement.end(2), ";", "left out")])
    return sorted(found, key=lambda changes: changes[0].start)
