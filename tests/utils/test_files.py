"""Files are whole or not there, and two writers do not touch each other."""

import os
import time

import pytest

from ndtorch.utils.files import LEFT_OVER, replacing, write_text


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


def test_what_a_killed_writer_left_goes_with_the_next_one(tmp_path):
    old, young = tmp_path / "part-01234567-a[1].txt", tmp_path / "part-89abcdef-a[1].txt"
    for left in (old, young):
        left.write_text("half")
    os.utime(old, (time.time() - 2 * LEFT_OVER,) * 2)
    write_text(tmp_path / "a[1].txt", "whole")
    assert sorted(tmp_path.iterdir()) == sorted([tmp_path / "a[1].txt", young])
