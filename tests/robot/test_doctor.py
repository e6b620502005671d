"""`ndtorch doctor`: what it says is so, a part that is broken is named, and what only costs a feature is no failure."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import itertools
import json
import re
import shutil
import subprocess
import sys
import textwrap
from importlib.metadata import entry_points
from pathlib import Path
from typing import get_type_hints

import numba
import pytest
import torch
from pydantic import BaseModel

from ndtorch.cli.commands import GROUP, main
from ndtorch.errors import InputError
from ndtorch.navigation import Body, NavigatorOptions, StereoRanging, controller_names
from ndtorch.utils.toml import read_toml
from ndtorch_robot import doctor
from ndtorch_robot.camera_monitor import CameraLimits
from ndtorch_robot.cameras import CameraSettings
from ndtorch_robot.config import DriveConfig, load_config
from ndtorch_robot.drive import drive
from ndtorch_robot.navigator_options import declared
from ndtorch_robot.run_config import (
    BodyTable,
    LimitsTable,
    NavigationTable,
    RigTable,
    RobotTable,
    RunConfig,
    SimulationTable,
)
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.car import CarLimits
from ndtorch_robot.sim.simulation import RIG


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


FOLDER = Path(__file__).parents[2] / "robot" / "configs"
DRIVES = ("maxstone8", "mini", "model-car", "delivery")


@pytest.mark.parametrize("name", DRIVES)
def test_a_robot_drives_five_seconds(name: str, tmp_path: Path) -> None:
    body = read_toml(FOLDER / f"{name}.toml", RunConfig).body.body()
    side = 6 * body.unit_m
    (tmp_path / "room.toml").write_text(f'name = "room"\nrooms = [[0, 0, {side}, {side}]]\nheight = 2.0\n')
    choices = {"robot": FOLDER / f"{name}.toml", "arena": str(tmp_path / "room.toml"), "seconds": 5.0}
    result = drive(load_config(None, choices))
    assert result.summary["collisions"] == 0
    assert result.summary["distance_m"] > 2 * body.cruise_m_per_s
    assert result.summary["body_lengths"] == pytest.approx(result.summary["distance_m"] / body.length_m, abs=0.1)


def test_the_robot_that_only_ranges(tmp_path: Path) -> None:
    kitti = read_toml(FOLDER / "kitti.toml", RunConfig)
    rig = kitti.stereo_rig()
    with pytest.raises(InputError, match=r"nowhere as wide as the robot needs \(8.56 m\)"):
        drive(load_config(None, {"robot": FOLDER / "kitti.toml", "seconds": 1.0}))
    row = torch.rand(1, 1, 1, rig.width + 40)
    ranges, _ = StereoRanging(rig, 0.1, search=kitti.navigation.options().search(rig, kitti.body.body()))(
        row[..., :-40], row[..., 40:]
    )
    assert ranges.x.shape == (1, 5)


def test_a_file_says_what_the_usual_robot_is() -> None:
    assert (BodyTable().body(), RobotTable().stereo_rig()) == (Body(), RIG)
    assert read_toml(FOLDER / "maxstone8.toml", RunConfig).body == BodyTable()
    limits = RobotTable().safety_limits()
    assert (limits.speed, limits.curvature) == (pytest.approx(0.6), pytest.approx(1 / 0.45))
    assert CarLimits.of(Body()) == CarLimits()


def test_options_of_the_file_lie_below_those_that_are_given() -> None:
    file = FOLDER / "mini.toml"
    assert load_config(None, {"robot": file}).stereo == "auto"
    assert load_config(None, {"robot": file, "stereo": "features"}).stereo == "features"
    assert load_config(None, {"robot": "mini"}) == load_config(None, {"robot": file})


COMMANDS = [point for point in entry_points(group=GROUP) if point.value.startswith("ndtorch_robot.")]
OPTIONS = {option.name for option in declared()}


def is_sentence(text: str | None) -> bool:
    return text is not None and text[:1].isupper() and text.endswith(".") and len(text.split()) > 3


@pytest.mark.parametrize("point", COMMANDS, ids=lambda point: point.name)
def test_options_of_commands(point) -> None:
    body = ast.parse(textwrap.dedent(inspect.getsource(point.load()))).body[0]
    assert isinstance(body, ast.ClassDef)
    told = {
        field.target.id: text.value.value
        for field, text in itertools.pairwise(body.body)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
    }
    assert told
    assert [name for name, text in told.items() if not is_sentence(str(text))] == []


def test_options_of_the_navigator() -> None:
    assert [option.name for option in declared() if not is_sentence(option.words)] == []


@pytest.mark.parametrize(
    "table",
    [
        *(BodyTable, LimitsTable, RigTable, RobotTable),
        *(CameraLimits, CameraSettings, DriveConfig, NavigationTable, RunConfig, SimulationTable),
    ],
)
def test_keys_of_files(table: type[BaseModel]) -> None:
    def is_table(kind: object) -> bool:
        parts = (kind, *getattr(kind, "__args__", ()))
        return any(isinstance(part, type) and issubclass(part, BaseModel) for part in parts)

    told = {
        key: field.description
        for key, field in table.model_fields.items()
        if key not in OPTIONS and not is_table(field.annotation)
    }
    assert [key for key, text in told.items() if not is_sentence(text)] in ([], ["cameras"])


def test_they_are_those_of_the_class() -> None:
    kinds = get_type_hints(NavigatorOptions)
    fields = [(field.name, kinds[field.name], field.default) for field in dataclasses.fields(NavigatorOptions)]
    assert [option[:3] for option in declared()] == fields
    assert all(option.words for option in declared())


def test_the_default_controller_exists() -> None:
    assert {option.name: option.default for option in declared()}["controller"] in controller_names()


def test_no_command_imports_torch_for_its_help(tmp_path: Path) -> None:
    program = (
        "import sys\nfrom ndtorch.cli.commands import installed, main\n"
        "for name in installed():\n"
        "    try:\n        main([name, '--help'])\n    except SystemExit as end:\n        assert end.code == 0, name\n"
        "    for module in ('torch', 'cv2', 'matplotlib', 'mujoco', 'scipy', 'sklearn'):\n"
        "        assert module not in sys.modules, f'{name} imports {module}'\n"
        "print('all', len(installed()))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=tmp_path, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1].startswith("all 1")


ROOT = Path(__file__).resolve().parents[2]
UNIT = ROOT / "robot" / "maxstone8.service"


def values(key):
    return [line.partition("=")[2] for line in UNIT.read_text().splitlines() if line.startswith(f"{key}=")]


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
@pytest.mark.parametrize("break_it", [False, True])
def test_systemd_takes_it(tmp_path, break_it):
    """With a program that is there in place of the one in /home/robot. An unknown key would be told."""
    text = UNIT.read_text().replace(values("ExecStart")[0].split()[0], sys.executable)
    text = text.replace(values("WorkingDirectory")[0], str(ROOT))
    text = text.replace("LimitRTPRIO", "LimitPriority") if break_it else text
    (tmp_path / UNIT.name).write_text(text)
    done = subprocess.run(
        ["systemd-analyze", "verify", "--recursive-errors=no", str(tmp_path / UNIT.name)],
        capture_output=True,
        text=True,
    )
    said = [line for line in done.stderr.splitlines() if UNIT.name in line]
    assert bool(said) == break_it, done.stderr
    assert not break_it or "LimitPriority" in said[0]


def test_what_it_starts_is_there():
    program, *arguments = values("ExecStart")[0].split()
    folder = values("WorkingDirectory")[0]
    assert program == f"{folder}/.venv/bin/ndtorch"  # where `make setup` puts it
    assert arguments[0] == "run"
    assert read_toml(ROOT / arguments[1], RunConfig).board_name == "maxston8"
    assert values("KillSignal") == ["SIGTERM"]
    assert int(values("LimitRTPRIO")[0]) >= 3  # what robot/ndtorch_robot/run.py asks for
    assert set(values("SupplementaryGroups")[0].split()) == {"dialout", "video"}
    assert "sudo cp robot/maxstone8.service" in (ROOT / "robot" / "README.md").read_text()


GUIDE = (Path(__file__).resolve().parents[2] / "docs" / "robot" / "simulation.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("number", "rings", "area"), [(0, 3, 24 + 4 * 1.6), (1, 1, 9 * (2 + 5) / 2), (2, 9, 16 + 15.6 + 0.08)]
)
def test_arenas_of_the_guide(tmp_path, number, rings, area):
    text = re.findall(r"```toml\n(.*?)```", GUIDE, flags=re.DOTALL)[number]
    file = tmp_path / "arena.toml"
    file.write_text(text)
    plan = load_arena(str(file))
    assert len(plan.rings) == rings
    assert plan.outline.area == pytest.approx(area)
    assert ("blank" in plan.outline.kinds) == (number == 1)


@pytest.mark.slow
def test_script_of_the_guide(capsys):
    script, _ = re.findall(r"```python\n(.*?)```", GUIDE, flags=re.DOTALL)
    names = {}
    exec(script, names)
    assert capsys.readouterr().out == "2.0 s, 0 collisions\n"
    assert names["world"].car.speed == pytest.approx(0.5)


@pytest.mark.long
def test_environment_of_the_guide():
    pytest.importorskip("gymnasium")
    _, script = re.findall(r"```python\n(.*?)```", GUIDE, flags=re.DOTALL)
    names = {}
    exec(script, names)
    assert 0 < names["reward"] < 0.5 / 30
    assert not names["terminated"]


def test_commands_of_the_guide_exist():
    from ndtorch.cli.commands import installed

    assert set(re.findall(r"ndtorch (\w+)", GUIDE)) <= set(installed())
