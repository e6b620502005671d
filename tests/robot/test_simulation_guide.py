"""What docs/robot/simulation.md shows works as it stands there."""

import re
from pathlib import Path

import pytest

from ndtorch_robot.sim.arenas import load_arena

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
