"""The tree behind a flame graph."""

from __future__ import annotations

from pathlib import Path

from tests.benchmarks.flame import draw, grown


def test_times_add_up_along_every_stack(tmp_path: Path) -> None:
    root = grown([(("a", "b"), 1.0), (("a", "c"), 2.0), (("a",), 0.5), (("d", "b"), 0.25)])
    assert root.seconds == 3.75
    assert {name: call.seconds for name, call in root.calls.items()} == {"a": 3.5, "d": 0.25}
    assert {name: call.seconds for name, call in root.calls["a"].calls.items()} == {"b": 1.0, "c": 2.0}
    assert root.calls["d"].calls["b"].seconds == 0.25
    draw(root, "four stacks", tmp_path / "four.png")
    assert (tmp_path / "four.png").stat().st_size > 1000
