"""A broken compiler is told from code of ours that does not compile."""

from __future__ import annotations

import pytest
import torch

from tests.compilers import broken_compiler


@pytest.mark.parametrize(
    ("capability", "words", "skipped"),
    [
        ("DEFAULT", "error: 'at::vec' has not been declared", True),
        ("AVX2", "error: 'at::vec' has not been declared", False),
        ("DEFAULT", "frames must be finite", False),
    ],
)
def test_what_is_skipped(capability: str, words: str, skipped: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: capability)
    assert bool(broken_compiler(RuntimeError(words))) is skipped
