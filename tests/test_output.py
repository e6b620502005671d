"""What is printed: nobody has to read it, a terminal obeys none of it, and what went wrong is one line."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch

from ndtorch.cli.command_run import what_the_system_said
from ndtorch.cli.commands import main
from ndtorch.cli.streams import Unblocked, escaped, line
from tests.command_line import refused

WRITES = """
import sys
from ndtorch.cli.streams import unblocked
sys.stderr = unblocked(sys.stderr)
for n in range(100_000):
    print("a line of a report", n, file=sys.stderr)
print("done")
"""


def test_a_pipe_that_nobody_reads_holds_up_nothing() -> None:
    reader, writer = os.pipe()
    try:
        done = subprocess.run([sys.executable, "-c", WRITES], stdout=subprocess.PIPE, stderr=writer, timeout=60)
        assert done.stdout == b"done\n"
        assert os.read(reader, 1 << 16).startswith(b"a line of a report 0\n")
    finally:
        os.close(reader)
        os.close(writer)


def test_what_is_read_again_is_written_again(tmp_path: Path) -> None:
    reader, writer = os.pipe()
    with os.fdopen(writer, "w") as stream:
        out = Unblocked(stream)
        began = time.process_time()
        while out.patience:
            out.write("x" * 4000)
        assert time.process_time() - began < 5
        os.read(reader, 1 << 20)
        out.write("again\n")
        assert os.read(reader, 100) == b"again\n"
        os.close(reader)
        out.write("the reader is gone\n")


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain, größer, 東\n\t", "plain, größer, 東\n\t"),
        ("\x1b[2J\x07", r"\x1b[2J\x07"),
        ("\x9b31m\u2028", r"\x9b31m\u2028"),
        ("a\udcff", r"a\udcff"),
    ],
)
def test_control_characters_are_shown_escaped(text: str, shown: str) -> None:
    assert escaped(text) == shown
    assert line("a\nb\x1b") == r"a\nb\x1b"


def test_a_file_name_goes_escaped_to_the_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(["bind", str(tmp_path / "\x1b]0;x\x07.mp4")], capsys, r"\x1b]0;x\x07.mp4")
    film = tmp_path / "\x1b[31m.avi"
    assert main(["render", "one-bar", str(film), "--seconds", "0.05", "--fps", "20"]) == 0
    assert r"\x1b[31m.avi: 1 frames" in capsys.readouterr().out


def test_memory_that_is_short_is_one_line_that_says_what_was_asked_for() -> None:
    with pytest.raises(RuntimeError) as of_torch:
        torch.empty(1 << 60)
    for error, words in (
        (of_torch.value, str(1 << 62)),
        (MemoryError("Unable to allocate 3. GiB for an array"), "3. GiB"),
        (MemoryError(), "not enough memory"),
        (OSError(errno.ENOMEM, os.strerror(errno.ENOMEM)), "not enough memory"),
        (NotADirectoryError(errno.ENOTDIR, "Not a directory", "clip.avi/x.mp4"), "clip.avi/x.mp4: Not a directory"),
    ):
        said = what_the_system_said(error)
        assert said is not None
        assert words in said
        assert "\n" not in said
    assert what_the_system_said(RuntimeError("size mismatch")) is None


def test_what_takes_longer_than_a_day_says_so_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from ndtorch.cli.command_run import told
    from ndtorch.run.progress import tell_if_long

    with told(quiet=False, muted=False):
        tell_if_long(200 * 86400 * 12)
        tell_if_long(1000)
    assert (
        capsys.readouterr().err == "note: 2.07e+08 frames: this takes longer than 12 days even at 200 frames a second\n"
    )
