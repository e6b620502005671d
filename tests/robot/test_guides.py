"""What the manual and the service file show works as it stands there."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from ndtorch.utils.toml import read_toml
from ndtorch_robot.run_config import RunConfig
from ndtorch_robot.sim.arenas import load_arena

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
    assert read_toml(ROOT / arguments[1], RunConfig).robot == "maxston8"
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
