"""`ndtorch doctor` names what is broken; robots of `robot/configs` drive; the service unit and the guide are right."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import SimpleNamespace

import numba
import pytest
import torch

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch.navigation import Body, StereoRanging, controller_names
from ndtorch_robot.commands import doctor
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.drive import drive
from ndtorch_robot.run_config import RigTable, RunConfig, read_run_config
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.simulation import RIG, CarLimits

ROOT = Path(__file__).resolve().parents[2]


def test_what_works_and_what_can_be_done_without(capsys, monkeypatch):
    monkeypatch.setattr("ndtorch_robot.cameras.source.list_devices", lambda: [])
    assert main(["doctor", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    findings = {finding["part"]: finding for finding in result["findings"]}
    assert result["failed"] == []
    assert findings["numba"]["words"] == numba.__version__
    assert torch.backends.cpu.get_cpu_capability() in findings["processor"]["words"]
    assert (findings["kernel cache"]["state"], findings["cameras"]["state"]) == ("works", "missing")


def test_what_is_broken_fails_with_advice(capsys, monkeypatch):
    load = doctor.import_module

    def missing(name):
        if name == "av":
            raise ImportError("libavcodec.so: cannot open shared object file\nmore")
        return SimpleNamespace(__version__="4.11.0") if name == "cv2" else load(name)

    monkeypatch.setattr(doctor, "import_module", missing)
    monkeypatch.setattr("ndtorch.utils.jit.make_private", lambda folder: False)
    assert main(["doctor"]) == 1
    out = capsys.readouterr().out
    assert "FAIL av" in out
    assert "pip install" in out
    assert "chmod 700" in out
    assert "4.11.0 (not loaded), but >=5 is asked for" in out
    assert "does not work: opencv-python-headless, av, kernel cache" in out


def test_preparing_compiles_all_controllers_and_models(capsys, monkeypatch):
    import ndtorch

    names = dict(doctor.preparations())
    assert {f"{name}, search" for name in controller_names()} | {*ndtorch.model_names()} <= {*names}
    names["published"]()
    monkeypatch.setattr(doctor, "preparations", lambda: [("one", lambda: None), ("two", lambda: None)])
    assert main(["doctor", "--prepare", "--json"]) == 0
    assert list(json.loads(capsys.readouterr().out)["prepared_s"]) == ["one", "two"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["maxstone8", "mini", "model-car", "delivery"])
def test_a_robot_drives_five_seconds(name: str, tmp_path: Path) -> None:
    body = read_run_config(Path(name)).body
    side = 6 * body.unit_m
    (tmp_path / "room.toml").write_text(f'name = "room"\nrooms = [[0, 0, {side}, {side}]]\nheight = 2.0\n')
    summary = drive(DriveConfig(robot=Path(name), arena=str(tmp_path / "room.toml"), seconds=5.0)).summary
    assert summary["collisions"] == 0
    assert summary["distance_m"] > 2 * body.cruise_m_per_s


def test_the_robot_that_only_ranges() -> None:
    kitti = read_run_config(Path("kitti"))
    rig = kitti.stereo_rig
    with pytest.raises(InputError, match=r"nowhere as wide as the robot needs \(8.56 m\)"):
        drive(DriveConfig(controller="published", robot=Path("kitti"), seconds=1.0))
    row = torch.rand(1, 1, 1, rig.width + 40)
    ranges, _ = StereoRanging(rig, 0.1)(row[..., :-40], row[..., 40:])
    assert ranges.x.shape == (1, 5)


def test_the_defaults_are_the_car_of_the_paper() -> None:
    car = read_run_config(Path("maxstone8"))
    assert (car.body, car.rig, car.stereo_rig) == (Body(), RigTable(), RIG)
    assert RunConfig(board_name="car", simulation={}).stereo_rig == RIG
    limits = car.safety_limits
    assert (limits.speed_m_per_s, limits.curvature_per_m) == (pytest.approx(0.6), pytest.approx(1 / 0.45))
    assert CarLimits.of(Body()) == CarLimits()


UNIT = ROOT / "robot" / "maxstone8.service"


def values(key):
    return [line.partition("=")[2] for line in UNIT.read_text().splitlines() if line.startswith(f"{key}=")]


def test_the_service_runs_the_car():
    program, *arguments = values("ExecStart")[0].split()
    assert program == f"{values('WorkingDirectory')[0]}/.venv/bin/ndtorch"  # where `make setup` puts it
    assert arguments[0] == "run"
    assert read_run_config(ROOT / arguments[1]).board_name == "maxston8"
    assert int(values("LimitRTPRIO")[0]) >= 3  # what robot/ndtorch_robot/run.py asks for


GUIDE = (ROOT / "docs" / "robot" / "simulation.md").read_text(encoding="utf-8")


def test_the_arena_of_the_guide(tmp_path):
    file = tmp_path / "arena.toml"
    file.write_text(re.findall(r"```toml\n(.*?)```", GUIDE, flags=re.DOTALL)[0])
    plan = load_arena(str(file))
    assert len(plan.rings) == 3
    assert plan.outline.area == pytest.approx(24 + 4 * 1.6)


@pytest.mark.slow
def test_script_of_the_guide(capsys):
    exec(re.findall(r"```python\n(.*?)```", GUIDE, flags=re.DOTALL)[0], {})
    assert capsys.readouterr().out == "2.0 s, 0 collisions, 0.5 m/s\n"
