"""The folder of a run: nothing that an earlier run left is lost, and nothing half-made is left."""

from __future__ import annotations

from pathlib import Path

import pytest

from ndtorch.errors import InputError
from ndtorch.run.folder import SETTINGS, RunFolder, place_for, prepare


def run(wanted: Path, text: str, whole: bool = True, force: bool = False) -> Path:
    """A run that leaves one file; gives its folder."""
    folder = RunFolder(wanted, force)
    (folder.work / "objects.json").write_text(text)
    assert [path.name for path in folder.publish(whole)] == ["objects.json"]
    return folder.final


def tree(folder: Path) -> dict[str, str]:
    return {str(path.relative_to(folder)): path.read_text() for path in folder.rglob("*") if path.is_file()}


def test_every_run_has_a_folder_of_its_own(tmp_path: Path) -> None:
    names = [run(tmp_path / "bars", str(number)).name for number in range(3)]
    assert names == ["bars", "bars-2", "bars-3"]
    assert tree(tmp_path) == {"bars/objects.json": "0", "bars-2/objects.json": "1", "bars-3/objects.json": "2"}


def test_runs_at_the_same_time_do_not_share_a_folder(tmp_path: Path) -> None:
    (tmp_path / "bars").mkdir()  # an empty folder is as good as none
    folders = [RunFolder(tmp_path / "bars") for _ in range(3)]
    for number, folder in enumerate(folders):
        (folder.work / "objects.json").write_text(str(number))
    folders[1].discard()
    folders[2].publish()
    folders[0].publish()
    assert tree(tmp_path) == {"bars/objects.json": "0", "bars-3/objects.json": "2"}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bars", "bars-3"]


def test_force_takes_the_folder_and_leaves_other_files(tmp_path: Path) -> None:
    run(tmp_path / "bars", "old")
    (tmp_path / "bars" / "notes.txt").write_text("mine")
    assert run(tmp_path / "bars", "new", force=True) == tmp_path / "bars"
    assert tree(tmp_path) == {"bars/objects.json": "new", "bars/notes.txt": "mine"}


def test_an_interrupted_run_never_replaces_a_finished_one(tmp_path: Path) -> None:
    run(tmp_path / "bars", "old")
    assert run(tmp_path / "bars", "part", whole=False, force=True).name == "bars-2"
    assert tree(tmp_path) == {"bars/objects.json": "old", "bars-2/objects.json": "part"}
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["bars", "bars-2", "objects.json", "objects.json"]


def test_the_same_settings_go_on_in_their_folder(tmp_path: Path) -> None:
    wanted = tmp_path / "maps"
    one = place_for(wanted, {"seeds": [1, 2]})
    assert one == (wanted, None)
    (wanted / "parts").mkdir()
    (wanted / "parts" / "a.json").write_text("1")
    assert place_for(wanted, {"seeds": [1, 2]}) == (wanted, None)

    other = place_for(wanted, {"seeds": [1, 2, 3]})
    assert other == (tmp_path / "maps-2", wanted)
    other.take_over("parts")
    other.take_over("nothing")
    (tmp_path / "maps-2" / "table.md").write_text("three")
    # Either is found again, and neither is written over.
    assert place_for(wanted, {"seeds": [1, 2]}).folder == wanted
    assert place_for(wanted, {"seeds": [1, 2, 3]}).folder == tmp_path / "maps-2"
    found = {name: text for name, text in tree(tmp_path).items() if SETTINGS not in name}
    assert found == {"maps/parts/a.json": "1", "maps-2/parts/a.json": "1", "maps-2/table.md": "three"}


def test_fresh_is_a_new_folder_and_force_any(tmp_path: Path) -> None:
    wanted = tmp_path / "maps"
    assert place_for(wanted, {"a": 1}).folder == wanted
    assert place_for(wanted, {"a": 1}, fresh=True) == (tmp_path / "maps-2", None)
    assert place_for(wanted, {"a": 2}, force=True) == (wanted, None)
    assert place_for(wanted, {"a": 2}) == (wanted, None)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    assert place_for(tmp_path / "mine", {"a": 1}) == (tmp_path / "mine-2", None)


def test_where_nothing_can_be_written(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    for wanted in (blocked, blocked / "bars", Path("/proc/nothing")):
        for take in (RunFolder, prepare, lambda folder: place_for(folder, {})):
            with pytest.raises(InputError, match=r"^--out .*cannot write there \(.+\)$"):
                take(wanted)
    assert tree(tmp_path) == {"file": "in the way"}
