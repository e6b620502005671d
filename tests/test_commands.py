"""The dispatcher: commands by entry points, one loaded at a time, broken ones told."""

from __future__ import annotations

import signal
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from ndtorch.cli import commands
from ndtorch.cli.commands import GROUP, main

MODULES = {
    "good": "from dataclasses import dataclass\n@dataclass\nclass Good:\n    '''Does good.'''\n"
    "    def run(self):\n        print('good')\n        return 0\n",
    "bad": "import no_such_module_of_anybody\n",
    "lacking": "import gymnasium\n",
    "wrong": "1 / 0\n",
    "ended": "import os, signal\nfrom dataclasses import dataclass\n@dataclass\nclass Ended:\n"
    "    '''Is told to end, with a signal by name.'''\n    number: str\n"
    "    def run(self):\n        os.kill(os.getpid(), getattr(signal, self.number))\n        return 0\n",
    "full": "from dataclasses import dataclass\n@dataclass\nclass Full:\n    '''Writes to a full disk.'''\n"
    "    def run(self):\n        raise OSError(28, 'No space left on device', 'run.rrd')\n",
    "later": "from dataclasses import dataclass\n@dataclass\nclass Later:\n    '''Misses something when it runs.'''\n"
    "    def run(self):\n        import gymnasium\n",
}


@pytest.fixture
def registered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands good, bad, lacking, wrong and later."""
    monkeypatch.syspath_prepend(tmp_path)
    points = []
    for name, text in MODULES.items():
        (tmp_path / f"command_{name}.py").write_text(text)
        points.append(EntryPoint(name, f"command_{name}:{name.title()}", GROUP))
    monkeypatch.setattr(commands, "entry_points", lambda group: points)
    monkeypatch.setitem(sys.modules, "gymnasium", None)


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line that the command ends with, with code 2."""
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return err


@pytest.mark.usefixtures("registered")
def test_broken_commands_leave_the_others(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["good"]) == 0
    assert capsys.readouterr().out == "good\n"
    assert "command_bad" not in sys.modules
    assert "no_such_module_of_anybody" in said(capsys, "bad")
    assert "ZeroDivisionError" in said(capsys, "wrong")
    assert main(["--help"]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines() if line.startswith("  ")}
    assert sorted(lines) == ["bad", "ended", "full", "good", "lacking", "later", "wrong"]
    assert "Does good." in lines["good"]
    assert "does not load" in lines["bad"]


@pytest.mark.usefixtures("registered")
@pytest.mark.parametrize("name", ["lacking", "later"])
def test_a_missing_extra_is_one_line_that_names_it(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert "gymnasium is not installed: pip install gymnasium" in said(capsys, name)


@pytest.mark.usefixtures("registered")
def test_commands_that_are_not_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert "did you mean good?" in said(capsys, "godo")
    assert "there are bad, ended, full, good" in said(capsys, "xylophone")
    assert "pip install ndtorch-robot" in said(capsys, "drive")
    assert "pip install ndtorch-train" in said(capsys, "reproduce")


@pytest.mark.usefixtures("registered")
@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_signals_end_a_command_as_ctrl_c_does(
    name: str, code: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["ndtorch", "ended", "--number", name])
    number = getattr(signal, name)
    before = signal.getsignal(number)
    assert commands.program() == code
    assert capsys.readouterr().err == "stopped before there was anything to keep\n"
    assert signal.getsignal(number) is before


@pytest.mark.usefixtures("registered")
def test_a_signal_that_is_ignored_stays_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """As `nohup` wants it."""
    monkeypatch.setattr(sys, "argv", ["ndtorch", "ended", "--number", "SIGHUP"])
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        assert commands.program() == 0
    finally:
        signal.signal(signal.SIGHUP, before)


def test_help_and_scenes_import_no_torch(tmp_path: Path) -> None:
    program = (
        "import sys\nfrom ndtorch.cli.commands import main\nassert main(['--help']) == main(['scenes']) == 0\n"
        "print(*[m for m in ('torch', 'cv2', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=tmp_path, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == ""


def test_a_reader_may_stop_reading(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "ndtorch", "scenes"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    assert process.stderr.read() == ""
    assert process.wait(120) == 141
    process.stderr.close()
