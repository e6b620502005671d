"""`ndtorch doctor`: what it says is so, a part that is broken is named, and what only costs a feature is no failure."""

import json
import subprocess
import sys

import numba
import pytest
import torch

from ndtorch.cli.commands import main
from ndtorch.navigation import controller_names
from ndtorch_robot import doctor


@pytest.fixture
def quick(monkeypatch):
    """Without processes of their own, which take seconds each."""
    asked = []

    def run(command, **options):
        asked.append(command[-1])
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(doctor.subprocess, "run", run)
    return asked


def findings(capsys):
    code = main(["doctor", "--json"])
    told = json.loads(capsys.readouterr().out)
    return code, {finding["part"]: finding for finding in told["findings"]}, told["failed"]


def test_what_works(capsys, quick):
    code, found, failed = findings(capsys)
    assert (code, failed) == (0, [])
    assert found["numba"]["words"] == numba.__version__
    assert torch.backends.cpu.get_cpu_capability() in found["torch"]["words"]
    assert all(name in found["controllers"]["words"] for name in controller_names())
    assert found["kernel cache"]["state"] == "works"
    assert quick[-1] == doctor.RENDER


def test_the_picture_is_drawn_where_there_is_opengl():
    """The program that `mujoco` is tried with says by its end whether it drew."""
    broken = subprocess.run(
        [sys.executable, "-c", doctor.RENDER],
        env={"MUJOCO_GL": "nonsense", "PATH": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    assert broken.returncode
    assert broken.stderr


def test_a_package_that_cannot_be_loaded_fails(capsys, quick, monkeypatch):
    load = doctor.import_module

    def missing(name):
        if name == "av":
            raise ImportError("libavcodec.so: cannot open shared object file\nmore")
        return load(name)

    monkeypatch.setattr(doctor, "import_module", missing)
    code, found, failed = findings(capsys)
    assert (code, failed) == (1, ["av"])
    assert found["av"]["advice"].startswith("pip install 'av")
    assert main(["doctor"]) == 1
    out = capsys.readouterr().out
    assert "FAIL av" in out
    assert "does not work: av" in out


def test_opengl_and_cameras_can_be_done_without(capsys, quick, monkeypatch):
    def run(command, **options):
        raise subprocess.TimeoutExpired(command, 60)

    monkeypatch.setattr(doctor.subprocess, "run", run)
    monkeypatch.setattr("ndtorch_robot.cameras.list_devices", lambda: [])
    code, found, _ = findings(capsys)
    assert code == 0
    assert found["OpenGL"]["state"] == found["cameras"]["state"] == "missing"
    assert "MUJOCO_GL=egl" in found["OpenGL"]["advice"]


def test_a_cache_that_cannot_be_used_fails(capsys, quick, monkeypatch):
    monkeypatch.setitem(vars(doctor.answer), "folder", None)
    code, found, failed = findings(capsys)
    assert (code, failed) == (1, ["kernel cache"])
    assert "chmod 700" in found["kernel cache"]["advice"]


def test_what_is_prepared_is_all_controllers_and_models():
    import ndtorch

    names = [name for name, _ in doctor.preparations()]
    assert {*controller_names()} == {name.split(",")[0] for name in names if "," in name}
    assert {*ndtorch.model_names()} <= {*names}


def test_preparing_says_what_it_took(capsys, quick, monkeypatch):
    done = []
    monkeypatch.setattr(
        doctor, "preparations", lambda: [("one", lambda: done.append(1)), ("two", lambda: done.append(2))]
    )
    assert main(["doctor", "--prepare", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert done == [1, 2]
    assert list(told["prepared_s"]) == ["one", "two"]


@pytest.mark.parametrize("name", ["foreground", "published"])
def test_what_is_prepared_runs(name):
    dict(doctor.preparations())[name]()
