"""The folder of compiled code: whose it is, who waits for whom, and what is deleted."""

from __future__ import annotations

import fcntl
import os
import stat
from pathlib import Path

import pytest

from ndtorch.utils.cache_folder import locked, own_files, private_folder, remove_stale


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
