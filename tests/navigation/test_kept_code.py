"""Compiled code that is kept between runs: only what is one's own and whole is given back."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from ndtorch.navigation.kept_code import KeptCode, UnusableFolder, cache_folder, content_hash, distrust, private_folder


@pytest.fixture
def kept(tmp_path: Path) -> KeptCode:
    return KeptCode(tmp_path / "cache")


def put(kept: KeptCode, name: str, text: str) -> Path:
    made = kept.folder / "made"
    made.write_text(text)
    return kept.keep(name, made)


def test_what_is_kept_is_found_by_name(kept: KeptCode) -> None:
    file = put(kept, "step", "code")
    assert kept.find("step") == (file, "")
    assert kept.find("other") == (None, "")
    assert file.read_text() == "code"
    assert file.stat().st_mode & 0o777 == 0o600
    assert not (kept.folder / "made").exists()


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (lambda file: file.write_text("evil"), "is damaged"),
        (lambda file: file.chmod(0o622), "can be written by other users"),
        (lambda file: (file.rename(file.with_name("away")), file.symlink_to(file.with_name("away"))), "no plain file"),
    ],
)
def test_what_is_not_as_it_was_left_is_removed(kept: KeptCode, spoil, why: str) -> None:
    file = put(kept, "step", "code")
    spoil(file)
    found, wrong = kept.find("step")
    assert found is None
    assert why in wrong
    assert not file.exists()
    assert not file.is_symlink()


def test_a_file_that_is_gone_is_not_trusted(tmp_path: Path) -> None:
    assert distrust(tmp_path / "gone", "") == "cannot be read (No such file or directory)"
    (tmp_path / "there").write_text("code")
    assert distrust(tmp_path / "there", content_hash(tmp_path / "there")) == ""


def test_the_folder_is_for_its_owner_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "open").mkdir(mode=0o755)
    assert private_folder(tmp_path / "open").stat().st_mode & 0o777 == 0o700
    monkeypatch.setattr(os, "getuid", lambda: 12345)
    with pytest.raises(UnusableFolder, match="belongs to another user"):
        private_folder(tmp_path / "open")
    (tmp_path / "file").write_text("")
    with pytest.raises(UnusableFolder, match="cannot be used"):
        private_folder(tmp_path / "file" / "below")


def test_where_it_lies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "ndtorch"
