"""The table of a run, and how a run continues."""

import json

import pytest

from ndtorch.errors import InputError
from ndtorch_robot.sim.firmware_host import FirmwareHost
from tests.fault_injection import __main__ as command
from tests.fault_injection.__main__ import FaultInjection, kept
from tests.fault_injection.table import SETTLING, failures, memory_growth, report, summary


def scenario(number, megabytes, rows, unexplained=()):
    return {
        "number": number,
        "arena": "curve",
        "seconds": 360.0,
        "wall_seconds": 90.0,
        "collisions": 0,
        "process": "a",
        "megabytes": megabytes,
        "faults": rows,
        "unexplained": list(unexplained),
        "blank": [],
        "carried": [],
    }


def row(failure=None, reaction=0.1):
    words = {"part": "camera", "fault": "black", "time_s": 1.0, "recovered_s": 1.0}
    return words | {"reaction_s": reaction, "failure": failure}


def test_table_and_failures():
    good = [scenario(n, 300.0 + (50.0 if n else 0.0), [row()]) for n in range(SETTLING + 2)]
    assert failures(good) == []
    assert summary(good)["megabytes_an_hour"] == 0.0
    assert "| camera | black | 0.25 | 8 | 0 | 0.10 | 0.10 | 1.0 |" in report(good)
    assert summary([*good, scenario(8, 360.0, [])])["scenarios_without_a_fault"] == 1
    bad = [*good[:-1], scenario(7, 360.0, [row("wheels turned for 0.400 s", 0.4)], ["3.00 s: why"])]
    assert len(failures(bad)) == 3  # a stop, wheels that turned, and memory
    assert "| camera | black | 0.25 | 8 | 1 | 0.10 | 0.40 | 1.0 |" in report(bad)


def test_memory_growth_is_one_slope_over_all_processes():
    """Scenarios of 0.1 h, of which the first ones load and compile."""
    loads = [scenario(n, 100.0 * n, []) for n in range(SETTLING)]
    flat = [scenario(n, 700.0 + (40.0 if n % 2 else 0.0), []) for n in range(40)]
    assert memory_growth([*loads, flat[0]]) is None
    assert memory_growth([*loads, *flat[:2]]) == pytest.approx(400.0)
    assert abs(memory_growth([*loads, *flat])) < 2.0
    leaks = [made | {"megabytes": made["megabytes"] + 1.2 * n} for n, made in enumerate(flat)]
    assert memory_growth([*loads, *leaks]) == pytest.approx(12.0, abs=2.0)
    others = [made | {"process": "b", "megabytes": made["megabytes"] + 500.0} for made in [*loads, *leaks]]
    assert memory_growth([*loads, *leaks, *others]) == pytest.approx(memory_growth([*loads, *leaks]))


def test_scenarios_of_other_code_are_driven_again(tmp_path):
    file = tmp_path / "scenario-0000.json"
    assert kept(file, {"code": "a"}) is None
    file.write_text(json.dumps({"key": {"code": "a"}, "seconds": 1}))
    assert kept(file, {"code": "a"})["seconds"] == 1
    assert kept(file, {"code": "b"}) is None
    file.write_text(file.read_text()[:-4])
    assert kept(file, {"code": "a"}) is None


def test_options_out_of_range(tmp_path):
    with pytest.raises(InputError, match="--scenario-seconds 10 to 3600"):
        FaultInjection(scenario_seconds=1.0, out=tmp_path).run()
    with pytest.raises(InputError, match="--first-scenario must be 0 to 999999, got -1"):
        FaultInjection(first_scenario=-1, out=tmp_path).run()


def test_a_run_continues_where_it_was(tmp_path, monkeypatch, capsys):
    driven = []

    def drive(config, number, seconds):
        driven.append((config.robot, number))
        return scenario(number, 300.0, [row()])

    monkeypatch.setattr(command, "drive_scenario", drive)
    monkeypatch.setattr(FirmwareHost, "code", staticmethod(lambda: "board"))
    out = tmp_path / "out"
    assert FaultInjection(minutes=1.0, scenario_seconds=60.0, out=out).run() == 0
    assert FaultInjection(minutes=3.0, scenario_seconds=60.0, out=out).run() == 0
    assert driven == [("maxston8", 0), ("maxston8", 1), ("maxston8", 2)]
    table = (out / "table.md").read_text()
    assert "scenarios 3," in table
    # A shorter run drives nothing, and its table leaves nothing out.
    capsys.readouterr()
    assert FaultInjection(minutes=1.0, scenario_seconds=60.0, out=out, json=True).run() == 0
    assert json.loads(capsys.readouterr().out)["scenarios"] == 3
    # Scenarios of another length go to another folder.
    assert FaultInjection(minutes=1.0, scenario_seconds=30.0, out=out).run() == 0
    assert (out / "table.md").read_text() == table
    assert "scenarios 2," in (tmp_path / "out-2" / "table.md").read_text()
    # Held-out scenarios are added to those that were driven.
    assert FaultInjection(minutes=2.0, scenario_seconds=60.0, first_scenario=7, out=out).run() == 0
    assert driven[-2:] == [("maxston8", 7), ("maxston8", 8)]
    assert "scenarios 5," in (out / "table.md").read_text()
