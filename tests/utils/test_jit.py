"""Functions under `@jit`: what they give, and where their code is kept."""

from __future__ import annotations

import importlib.util
import os
import shutil
import stat
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from ndtorch.utils.jit import code_folder

CODE = """
from ndtorch.utils.jit import jit

SCALE = 2.0

@jit
def scaled(x):
    return SCALE * x

@jit
def total(numbers):
    out = 0.0
    for n in range(numbers.shape[0]):
        out += scaled(numbers[n])
    return out
"""


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A cache of its own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    code_folder.cache_clear()
    yield tmp_path
    code_folder.cache_clear()


def load(folder: Path, code: str = CODE) -> ModuleType:
    """The module as a new process has it."""
    file = folder / "jitted_sums.py"
    file.write_text(code)
    # Python would take bytecode of a file of the same size and second.
    shutil.rmtree(folder / "__pycache__", ignore_errors=True)
    spec = importlib.util.spec_from_file_location("jitted_sums", file)
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    sys.modules["jitted_sums"] = made
    spec.loader.exec_module(made)
    code_folder.cache_clear()
    return made


def test_code_is_kept_for_the_next_process_and_made_anew_when_what_it_calls_changes(kept: Path) -> None:
    numbers = np.array([1.0, 2.5, 4.0])
    sums = load(kept)
    assert sums.total(numbers) == 2 * numbers.sum()
    assert sums.total(numbers.astype(np.float32)) == 2 * numbers.sum()
    assert sums.scaled.function(3.0) == 6.0
    again = load(kept)
    assert again.total(numbers) == 2 * numbers.sum()
    assert sum(again.total.dispatcher.stats.cache_hits.values()) == 1
    for change, factor in (("SCALE = 3.0", 3), ("SCALE = 2.0 + 2.0", 4)):
        assert load(kept, CODE.replace("SCALE = 2.0", change)).total(numbers) == factor * numbers.sum()


def test_the_folder_is_for_its_owner_alone(kept: Path) -> None:
    (kept / "cache" / "ndtorch").mkdir(parents=True, mode=0o777)
    sums = load(kept)
    for folder in (kept / "cache" / "ndtorch", sums.total.folder):
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700


@pytest.mark.parametrize("why", ["another owner", "a file in the way"])
def test_where_nothing_can_be_kept_it_computes_all_the_same(
    why: str, kept: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if why == "another owner":
        uid = os.getuid()
        monkeypatch.setattr(os, "getuid", lambda: uid + 1)
    else:
        (kept / "cache").write_text("")
    sums = load(kept)
    assert sums.total.folder is None
    assert sums.total(np.ones(3)) == 6
