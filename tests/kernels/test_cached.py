"""Kernels from the cache are ready without what compiling needs, and compiling still works after one."""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from ndtorch.kernels import load

DAMAGES = {
    "cut": lambda data: data[: len(data) // 2],
    "empty": lambda data: b"",
    "a bit of its code": lambda data: data[:-2000] + bytes([data[-2000] ^ 4]) + data[-1999:],
    "a bit of its beginning": lambda data: data[:40] + bytes([data[40] ^ 4]) + data[41:],
    "other bytes": lambda data: b"x" * 300,
}

USE = """
import sys
import numpy as np
from ndtorch.kernels.load import kernel

def sums(kind):
    tiles = np.zeros((1, 4), kind)
    kernel("tile_sums", kind).run(np.array([1, 1, 3]), np.array([0.5, 0.25, 2], kind), np.array([0]), tiles)
    return tiles[0].tolist()

print(sums(np.float32), "numba.np.linalg" in sys.modules, "scipy.linalg" in sys.modules)
print(sums(np.float64), "numba.np.linalg" in sys.modules)
"""


def test_a_kernel_is_loaded_without_what_compiling_needs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("numba")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    load.code_folder.cache_clear()
    try:
        compiled = load.kernel.__wrapped__("tile_sums")
        tiles = np.zeros((1, 4), np.float32)
        compiled.run(np.array([2]), np.ones(1, np.float32), np.array([0]), tiles)
    finally:
        load.code_folder.cache_clear()
    assert tiles.tolist() == [[0, 0, 1, 0]]
    said = subprocess.run([sys.executable, "-c", USE], capture_output=True, text=True, timeout=120, check=True)
    # The second precision is not in the cache: it is compiled, in the same process.
    assert said.stdout.splitlines() == ["[0.0, 0.75, 0.0, 2.0] False False", "[0.0, 0.75, 0.0, 2.0] True"]


def test_with_another_numba_that_does_it_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    numba = pytest.importorskip("numba")
    from ndtorch.kernels import cached
    from ndtorch.kernels.tile_sums import tile_sums

    monkeypatch.setattr(numba, "__version__", "0.99.0")
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    usual = cached.compiled(tile_sums, load.OPTIONS, keep=True)
    assert not isinstance(usual._cache, cached.QuickCache)
    tiles = np.zeros((1, 4), np.float32)
    usual(np.array([2]), np.ones(1, np.float32), np.array([0]), tiles)
    assert tiles.tolist() == [[0, 0, 1, 0]]
    assert list(tmp_path.rglob("*.nbc"))


def tile_sums_of(kept: Path) -> list[float]:
    """By a kernel that is new to this process, with what is kept in a folder."""
    compiled = load.kernel.__wrapped__("tile_sums")
    assert compiled.folder is not None
    assert compiled.folder.is_relative_to(kept)
    tiles = np.zeros((1, 4), np.float32)
    compiled.run(np.array([2, 3, 3]), np.array([1, 2, 4], np.float32), np.array([0]), tiles)
    return [float(each) for each in tiles[0]]


def test_damaged_code_is_never_loaded_but_compiled_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is wrong with a file or with the index, and it is said in one line; the next process finds it whole."""
    pytest.importorskip("numba")
    from ndtorch.kernels import cached

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    load.code_folder.cache_clear()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert tile_sums_of(tmp_path) == [0, 0, 1, 6]
        for end, compiled in ((".nbc", "a bit of its code"), (".nbi", "cut")):
            file = next(tmp_path.rglob(f"*{end}"))
            whole, words = file.read_bytes(), f"the compiled code in {file} is damaged: it is compiled again"
            for name in [name for name in DAMAGES if len(whole) > 2000 or "code" not in name]:
                file.write_bytes(DAMAGES[name](whole))
                with pytest.warns(UserWarning, match=re.escape(words)):
                    assert cached.unspoiled(file) is None, name
            # One of them all the way, for that takes long.
            file.write_bytes(DAMAGES[compiled](whole))
            with pytest.warns(UserWarning, match=re.escape(words)):
                assert tile_sums_of(tmp_path) == [0, 0, 1, 6]
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                assert cached.unspoiled(file) is not None
                assert tile_sums_of(tmp_path) == [0, 0, 1, 6]
    finally:
        load.code_folder.cache_clear()
