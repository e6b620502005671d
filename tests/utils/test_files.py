"""Files are whole or not there, and what is read is what was written, or refused in one line."""

from __future__ import annotations

import importlib
import os
import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors.torch
import torch

from ndtorch.errors import InputError
from ndtorch.utils import files
from ndtorch.utils.files import (
    load_arrays,
    read_tensors,
    read_text,
    replacing,
    save_arrays,
    save_tensors,
    write_text,
)
from ndtorch.utils.toml import check, toml_values


def test_a_new_file_takes_the_place_of_the_old(tmp_path):
    path = tmp_path / "a.txt"
    write_text(path, "old")
    with replacing(path) as beside:
        assert beside.suffix == ".txt"
        beside.write_text("new")
        assert path.read_text() == "old"
        assert [file.name.startswith(".") for file in tmp_path.iterdir()] == [False, False]
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_what_fails_leaves_the_old_file_alone(tmp_path, error):
    path = tmp_path / "a.txt"
    write_text(path, "old")

    def half():
        with replacing(path) as beside:
            beside.write_text("ha")
            raise error

    with pytest.raises(type(error)):
        half()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


ARRAYS = {
    "cells": np.arange(60, dtype=np.float32).reshape(5, 12),
    "cell": np.array(0.05),
    "names": np.array(["a", "bc"]),
}
TENSORS = {"motion": torch.arange(16.0).reshape(4, 4), "count": torch.tensor(3)}


def same(found: Any, wanted: Any) -> bool:
    return set(found) == set(wanted) and all(
        found[name].dtype == value.dtype
        and found[name].shape == value.shape
        and np.array_equal(np.asarray(found[name]), np.asarray(value))
        for name, value in wanted.items()
    )


def test_arrays_come_back_and_numpy_reads_them_too(tmp_path: Path) -> None:
    save_arrays(tmp_path / "map.npz", ARRAYS)
    assert same(load_arrays(tmp_path / "map.npz"), ARRAYS)
    with np.load(tmp_path / "map.npz") as file:
        assert np.array_equal(file["cells"], ARRAYS["cells"])
    assert [path.name for path in tmp_path.iterdir()] == ["map.npz"]


def test_tensors_without_a_checksum_are_refused(tmp_path: Path) -> None:
    safetensors.torch.save_file(TENSORS, tmp_path / "map.safetensors")
    with pytest.raises(InputError, match=r"map\.safetensors has no checksum"):
        read_weights(tmp_path / "map.safetensors")
    with pytest.raises(InputError, match="is missing"):
        load_arrays(tmp_path / "none.npz")


def read_weights(path: Path) -> Any:
    return read_tensors(path, "weights")[0]


@pytest.mark.parametrize(
    ("save", "load", "wanted"),
    [
        (lambda path: save_arrays(path, ARRAYS), load_arrays, ARRAYS),
        (lambda path: save_tensors(TENSORS, path), read_weights, TENSORS),
    ],
    ids=["npz", "safetensors"],
)
def test_a_damaged_file_is_never_believed(
    tmp_path: Path, save: Callable[[Path], None], load: Callable[[Path], Any], wanted: Any
) -> None:
    """Any byte of it, and any end: what is read is what was written, or it is refused."""
    path, chance, refused = tmp_path / "file.npz", random.Random(1), 0
    save(path)
    whole = path.read_bytes()
    for n in range(400):
        damaged = bytearray(whole)
        if n % 4:
            damaged[chance.randrange(len(whole))] ^= chance.randrange(1, 256)
        else:
            del damaged[chance.randrange(len(whole)) :]
        path.write_bytes(damaged)
        found, why = outcome(load, path)
        # The names in a zip file have no CRC: an array may be missing.
        assert found is None or same(found, {name: value for name, value in wanted.items() if name in found})
        assert found is not None or ("file.npz" in why and "\n" not in why)
        refused += found is None
    assert refused > 200


def outcome(load: Callable[[Path], Any], path: Path) -> tuple[Any, str]:
    """What was read, or why nothing was."""
    try:
        return load(path), ""
    except InputError as error:
        return None, str(error)


def test_an_archive_that_unpacks_to_more_than_it_may_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "ARRAY_BYTES", 1 << 20)
    save_arrays(tmp_path / "a.npz", {"zeros": np.zeros(1 << 20)})
    assert (tmp_path / "a.npz").stat().st_size < 1 << 16
    with pytest.raises(InputError, match="more than"):
        load_arrays(tmp_path / "a.npz")


@pytest.mark.parametrize("read", [load_arrays, read_weights, toml_values, read_text])
def test_only_regular_files_of_a_stated_size_are_read(read: Callable[[Path], Any], tmp_path: Path) -> None:
    """A pipe without a writer would be waited for, a device has no end, and a file with a hole takes no disk."""
    os.mkfifo(tmp_path / "pipe")
    with (tmp_path / "hole").open("wb") as file:
        file.truncate(3 << 30)
    for path, words in (
        *((tmp_path / "pipe", "no regular file"), (Path("/dev/zero"), "no regular file")),
        *((tmp_path, "no regular file"), (tmp_path / "hole", "are the most")),
    ):
        with pytest.raises(InputError, match=words):
            read(path)


@dataclass(frozen=True)
class Inner:
    gain: float = 1.0

    def __post_init__(self) -> None:
        if self.gain < 0:
            raise InputError(f"gain must be >= 0, got {self.gain}")


@dataclass(frozen=True)
class Outer:
    name: str
    inner: Inner = Inner()
    sizes: tuple[int, ...] = (1, 2)
    file: Path | None = None


def test_a_table_becomes_a_dataclass() -> None:
    assert check({"name": "a", "inner": {"gain": 2}, "sizes": [3], "file": "x"}, Outer, "f") == Outer(
        "a", Inner(2.0), (3,), Path("x")
    )
    for values, words in (
        ({}, "f: name is missing"),
        ({"name": 3}, "f: name = 3: "),
        ({"name": "a", "sizes": [True]}, "f: sizes.0 = True: "),
        ({"nam": "a"}, r"f: unknown key 'nam'; did you mean name\?"),
        ({"name": "a", "inner": {"gian": 1}}, r"f: unknown key 'inner.gian'; did you mean gain\?"),
        ({"name": "a", "inner": {"gain": -1}}, "f: inner: gain must be >= 0"),
    ):
        with pytest.raises(InputError, match=words):
            check(values, Outer, "f")


def test_a_registry_finds_its_parts_in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "parts_of_mine").mkdir()
    (tmp_path / "parts_of_mine" / "__init__.py").write_text(
        "from ndtorch.utils.registry import Registry\nPARTS = Registry('part', __name__)\n"
    )
    (tmp_path / "parts_of_mine" / "one.py").write_text("from . import PARTS\nPARTS.register('one')(1)\n")
    monkeypatch.syspath_prepend(tmp_path)
    parts = importlib.import_module("parts_of_mine").PARTS
    assert parts.find("one") == 1
    with pytest.raises(InputError, match=r"part must be one of one, got 'oen'; did you mean one\?"):
        parts.find("oen")
    with pytest.raises(InputError, match="there is a part 'one' already"):
        parts.register("one")(2)
