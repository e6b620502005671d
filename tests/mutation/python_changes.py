"""Changes of Python source, by the operators of cosmic-ray."""

from __future__ import annotations

import ast
import hashlib
import json
import re
from collections.abc import Collection, Iterator
from importlib.metadata import version
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names

from tests.mutation.change import Change

Position = tuple[int, int]


def places(text: str, without: Collection[str]) -> list[list[tuple[str, int, int]]]:
    """Every place that can be changed: its changes as operator, occurrence and line.

    An operator has several changes, so places are drawn, not changes.
    """
    tree = get_ast(text)
    nodes = list(ast_nodes(tree))
    passed_over = list(unread(ast.parse(text)))
    found: dict[tuple[Position, Position], list[tuple[str, int, int]]] = {}
    for name in operator_names():
        operator = get_operator(name)
        if operator.arguments() or any(re.search(pattern, name) for pattern in without):
            continue
        made = operator()
        positions = (place for node in nodes for place in made.mutation_positions(node))
        for occurrence, (start, end) in enumerate(positions):
            if not any(first <= start < last for first, last in passed_over):
                found.setdefault((start, end), []).append((name, occurrence, start[0]))
    return [found[place] for place in sorted(found)]


def kept_places(text: str, without: Collection[str], folder: Path) -> list[list[tuple[str, int, int]]]:
    """The same, looked up in `folder` where it was found before: a file takes seconds."""
    digest = hashlib.sha256(repr((version("cosmic-ray"), text, list(without))).encode()).hexdigest()[:32]
    path = folder / f"{digest}.json"
    if path.is_file():
        return [
            [(name, occurrence, line) for name, occurrence, line in place] for place in json.loads(path.read_text())
        ]
    found = places(text, without)
    folder.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(found))
    return found


def unread(tree: ast.Module) -> Iterator[tuple[Position, Position]]:
    """Spans that nothing evaluates: annotations, and imports for types alone."""
    for node in ast.walk(tree):
        spans: list[ast.expr | ast.stmt | None] = []
        if isinstance(node, ast.AnnAssign | ast.arg):
            spans = [node.annotation]
        elif isinstance(node, ast.FunctionDef):
            spans = [node.returns]
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            spans = [node]
        for span in spans:
            if span is not None:
                yield (span.lineno, span.col_offset), (span.end_lineno or 0, span.end_col_offset or 0)


def change(file: str, text: str, operator: str, occurrence: int, line: int) -> Change | None:
    """That change; None where the source stays the same or is no Python any more."""
    changed = mutate_code(text, get_operator(operator)(), occurrence)
    if changed is None or changed == text:
        return None
    try:
        ast.parse(changed)
    except SyntaxError:
        return None
    start = next(i for i, (a, b) in enumerate(zip(text + "\0", changed + "\1", strict=False)) if a != b)
    tail = 0
    while tail < min(len(text), len(changed)) - start and text[-1 - tail] == changed[-1 - tail]:
        tail += 1
    return Change(file, line, start, len(text) - tail, changed[start : len(changed) - tail], operator.split("/")[1])
