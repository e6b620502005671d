"""The robots of robot/configs: every file loads, and those that fit into a room drive."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Body, StereoRanging
from ndtorch.utils.toml import read_toml
from ndtorch_robot.config import load_config
from ndtorch_robot.drive import drive
from ndtorch_robot.robot_config import BodyTable, RobotTable
from ndtorch_robot.run_config import RunConfig
from ndtorch_robot.sim.car import CarLimits
from ndtorch_robot.sim.simulation import RIG

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
    with pytest.raises(InputError, match=r"camera_height_m is now camera_height_m of \[body\]"):
        read_toml_of('robot = "x"\n[rig]\ncamera_height_m = 0.2\n')


def read_toml_of(text: str) -> RunConfig:
    import tomllib

    from ndtorch.utils.toml import check

    return check(tomllib.loads(text), RunConfig, "text")


def test_options_of_the_file_lie_below_those_that_are_given() -> None:
    file = FOLDER / "mini.toml"
    assert load_config(None, {"robot": file}).stereo == "auto"
    assert load_config(None, {"robot": file, "stereo": "features"}).stereo == "features"
    assert load_config(None, {"robot": "mini"}) == load_config(None, {"robot": file})
