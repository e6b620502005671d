"""When kernels are used, and where they are kept."""

from __future__ import annotations

import fcntl
import os
import stat
from pathlib import Path

import pytest
import torch

from ndtorch.kernels import load, switch
from ndtorch.kernels.folder import UnusableFolder, cache_folder, locked, private_folder


@pytest.fixture
def fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing was looked up so far."""
    monkeypatch.setattr(load.code_folder, "cache_clear", load.code_folder.cache_clear)
    load.code_folder.cache_clear()
    yield
    load.code_folder.cache_clear()


def test_kernels_are_for_inference_on_the_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(switch, "installed", lambda: True)
    assert not switch.kernels_wanted(torch.zeros(1))
    with torch.no_grad():
        assert not switch.kernels_wanted(torch.zeros(1))
    with torch.inference_mode():
        assert switch.kernels_wanted(torch.zeros(1))
        assert not switch.kernels_wanted(torch.zeros(1), torch.zeros(1, device="meta"))
        monkeypatch.setenv("NDTORCH_KERNELS", "0")
        monkeypatch.setattr(switch, "switched_on", switch.switched_on.__wrapped__)
        assert not switch.kernels_wanted(torch.zeros(1))


def test_without_numba_torch_does_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(switch, "installed", lambda: False)
    with torch.inference_mode():
        assert not switch.kernels_wanted(torch.zeros(1))


def test_only_the_owner_can_enter_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fresh: None) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = load.code_folder("1.0")
    assert folder is not None
    assert folder.is_relative_to(tmp_path / "ndtorch")
    for place in (folder, folder.parent):
        assert stat.S_IMODE(place.stat().st_mode) == 0o700
    folder.chmod(0o777)
    assert stat.S_IMODE(private_folder(folder).stat().st_mode) == 0o700


def test_other_versions_have_other_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fresh: None) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert load.code_folder("1.0") != load.code_folder("1.1")


def test_a_folder_that_cannot_be_used_is_done_without(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fresh: None
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert load.code_folder("1.0") is None
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(Path, "home", lambda: (_ for _ in ()).throw(RuntimeError))
    with pytest.raises(UnusableFolder, match="no home"):
        cache_folder()


def test_folders_that_nobody_uses_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fresh: None) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    home = private_folder(tmp_path / "ndtorch")
    for name in ("kernels-old", "kernels-used", "kernels-locked", "other-old"):
        with locked(home / name):
            (home / name / "code.nbc").write_bytes(b"1")
        if name != "kernels-used":
            os.utime(home / name / "lock", (0, 0))
    (home / "kernels-strange").mkdir()
    held = (home / "kernels-locked" / "lock").open()
    with held:
        fcntl.flock(held, fcntl.LOCK_EX)
        now = load.code_folder("1.0")
    assert now is not None
    left = {folder.name for folder in home.iterdir()}
    assert left == {"kernels-used", "kernels-locked", "other-old", "kernels-strange", now.name}


def test_a_folder_that_is_gone_is_made_anew(tmp_path: Path) -> None:
    with locked(tmp_path / "kernels-1"):
        assert (tmp_path / "kernels-1" / "lock").is_file()


def test_parts_of_a_folder_are_locked_apart(tmp_path: Path) -> None:
    folder = tmp_path / "kernels-1"
    with locked(folder, "one"), locked(folder, "two"):
        for name in ("one.lock", "two.lock", "lock"):
            with (folder / name).open() as file, pytest.raises(BlockingIOError):
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
