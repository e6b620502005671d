"""Functions under `@jit`: what they give, where their code is kept, and what happens when it is damaged."""

from __future__ import annotations

import fcntl
import importlib.util
import logging
import math
import os
import shutil
import stat
import sys
import threading
import warnings
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from ndtorch.utils.cache_folder import locked, log, own_files, private_folder, remove_stale
from ndtorch.utils.jit import announce, code_folder, compiling_beside, jit
from ndtorch.utils.selection import median

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


def test_a_compiled_function_calls_another(kept: Path) -> None:
    numbers = np.array([1.0, 2.5, 4.0])
    sums = load(kept)
    assert sums.total(numbers) == 2 * numbers.sum()
    assert sums.total(numbers.astype(np.float32)) == 2 * numbers.sum()
    assert sums.scaled.function(3.0) == 6.0


def test_code_is_kept_for_the_next_process(kept: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG, "ndtorch.jit")
    announce.cache_clear()
    assert load(kept).total(np.ones(3)) == 6
    assert [record.levelname for record in caplog.records] == ["INFO", "DEBUG"]
    again = load(kept)
    assert again.total(np.ones(3)) == 6
    assert len(caplog.records) == 2
    assert sum(again.total.dispatcher.stats.cache_hits.values()) == 1


def test_code_that_numba_writes_again_is_not_damaged(kept: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for process in range(4):
            sums = load(kept)
            assert [sums.total(np.ones(3, kind)) for kind in (np.float64, np.float32)] == [6, 6]
            # As when the file is installed again: Numba numbers all signatures anew.
            (index,) = (kept / "cache").rglob("*total*.nbi")
            if process % 2:
                index.unlink()


def test_one_process_writes_at_a_time_for_every_signature(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sums, waits = load(kept), threading.Event()
    assert sums.total(np.ones(3)) == 6
    monkeypatch.setattr(log, "info", lambda *_: waits.set())
    with ThreadPoolExecutor() as threads:
        with locked(sums.total.folder, "total"):
            other = threads.submit(sums.total, np.ones(3, np.float32))
            assert waits.wait(60)
            assert len(list((kept / "cache").rglob("*total*.nbc"))) == 1
        assert other.result() == 6
    assert len(list((kept / "cache").rglob("*total*.nbc"))) == 2


@pytest.mark.parametrize("change", [("SCALE = 2.0", "SCALE = 3.0"), ("SCALE * x", "SCALE * x + 1")])
def test_a_change_of_what_is_called_compiles_again(kept: Path, change: tuple[str, str]) -> None:
    assert load(kept).total(np.ones(3)) == 6
    assert load(kept, CODE.replace(*change)).total(np.ones(3)) == 9


@pytest.mark.parametrize(
    ("end", "damage"), [(".nbi", "empty"), (".nbi", "cut"), (".nbc", "empty"), (".nbc", "cut"), (".nbc", "one bit")]
)
def test_damaged_code_is_replaced(kept: Path, end: str, damage: str) -> None:
    assert load(kept).total(np.ones(3)) == 6
    (file,) = (kept / "cache").rglob(f"*total*{end}")
    data = file.read_bytes()
    middle = len(data) // 2
    flipped = data[:middle] + bytes([data[middle] ^ 4]) + data[middle + 1 :]
    written = file.stat().st_mtime_ns
    file.write_bytes({"empty": b"", "cut": data[:middle], "one bit": flipped}[damage])
    os.utime(file, ns=(written, written))
    with pytest.warns(UserWarning, match="was damaged and is replaced"):
        assert load(kept).total(np.ones(3)) == 6
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert load(kept).total(np.ones(3)) == 6


def test_files_that_others_may_write_are_not_read(kept: Path) -> None:
    assert load(kept).total(np.ones(3)) == 6
    (file,) = (kept / "cache").rglob("*total*.nbi")
    file.write_bytes(b"not an index")
    file.chmod(0o666)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert load(kept).total(np.ones(3)) == 6


def test_without_a_folder_it_is_compiled_all_the_same(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (kept / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(kept / "file"))
    assert load(kept).total(np.ones(3)) == 6


def test_exact_functions_keep_their_order() -> None:
    @jit(exact=True)
    def compensated(a: float, b: float) -> float:
        return (a + b) - a - b

    rounding = compensated(1e16, math.pi)
    assert rounding == (1e16 + math.pi) - 1e16 - math.pi
    assert rounding != 0


def test_medians_of_many_few_and_equal_numbers() -> None:
    chance = np.random.default_rng(3)
    some = [chance.random(900), chance.integers(0, 4, 900), np.ones(900), np.arange(900), -np.arange(900.0)]
    rows = [*some, np.exp(9 * chance.standard_normal(900))]
    numbers = np.repeat(np.array(rows, np.float32), 60, 0)
    counts, before = chance.integers(1, 901, len(numbers)), numbers.copy()
    for row, count in zip(numbers, counts.tolist(), strict=True):
        assert np.float32(median(row, count)) == np.median(row[:count])
    assert np.array_equal(numbers, before)


def test_another_process_compiles_beside_where_nothing_is_kept(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    scaled, work = load(kept).scaled, partial(Path.touch, kept / "done")
    with compiling_beside(work, scaled):
        assert scaled(1.0) == 2.0
    assert (kept / "done").exists()
    (kept / "done").unlink()
    with compiling_beside(work, scaled):
        pass
    assert not (kept / "done").exists()
    with compiling_beside(lambda: None, load(kept, CODE + "#").total):  # cannot be pickled: compiled here alone
        pass


def test_only_the_owner_can_enter_the_folder(tmp_path: Path) -> None:
    folder = private_folder(tmp_path / "ndtorch")
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    folder.chmod(0o777)
    assert stat.S_IMODE(private_folder(folder).stat().st_mode) == 0o700


@pytest.mark.skipif(os.getuid() != 0, reason="only root gives files away")
def test_a_file_of_another_user_is_deleted_unread(tmp_path: Path) -> None:
    for name in ("mine", "theirs"):
        (tmp_path / name).write_text("")
    os.chown(tmp_path / "theirs", 12345, -1)
    assert own_files(tmp_path) == [tmp_path / "mine"]
    assert not (tmp_path / "theirs").exists()


def test_files_that_others_may_write_and_links_are_deleted(tmp_path: Path) -> None:
    for name in ("mine", "shared"):
        (tmp_path / name).write_text("")
    (tmp_path / "shared").chmod(0o664)
    (tmp_path / "link").symlink_to(tmp_path / "mine")
    (tmp_path / "mine").chmod(0o644)
    assert own_files(tmp_path) == [tmp_path / "mine"]
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_folders_that_nobody_uses_are_deleted(tmp_path: Path) -> None:
    for name in ("jit-old", "jit-used", "jit-locked", "other-old"):
        with locked(tmp_path / name):
            (tmp_path / name / "code.nbc").write_bytes(b"1")
        if name != "jit-used":
            os.utime(tmp_path / name / "lock", (0, 0))
    (tmp_path / "jit-strange").mkdir()
    with (tmp_path / "jit-locked" / "lock").open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        remove_stale(tmp_path / "jit-new", "jit-*")
    assert {folder.name for folder in tmp_path.iterdir()} == {"jit-used", "jit-locked", "other-old", "jit-strange"}


def test_parts_of_a_folder_are_locked_apart(tmp_path: Path) -> None:
    folder = tmp_path / "jit-1"
    with locked(folder, "one"), locked(folder, "two"):
        for name in ("one.lock", "two.lock", "lock"):
            with (folder / name).open() as file, pytest.raises(BlockingIOError):
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
