"""The table of a soak, and how a soak goes on where it was."""

import json

import pytest

from ndtorch.ending import Stopped
from ndtorch.errors import InputError
from ndtorch_robot.commands.soak import Soak, kept
from ndtorch_robot.sim.hosted_board import HostedBoard
from ndtorch_robot.soak.table import SETTLES, growth, report, summary, troubles


def piece(number, megabytes, rows, unexplained=()):
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


def row(bad=None, turned=0.1):
    return {"part": "camera", "fault": "black", "at": 1.0, "turned": turned, "bad": bad, "on after": 1.0}


def test_the_table_tells_what_was_bad():
    good = [piece(n, 300.0 + (50.0 if n else 0.0), [row()]) for n in range(SETTLES + 2)]
    assert troubles(good) == []
    assert summary(good)["megabytes_an_hour"] == 0.0
    assert "| camera | black | 0.25 | 8 | 0 | 0.10 | 0.10 | 1.0 |" in report(good)
    assert summary(good)["pieces_without_a_fault"] == 0
    assert summary([*good, piece(8, 360.0, [])])["pieces_without_a_fault"] == 1
    bad = [*good[:-1], piece(7, 360.0, [row("wheels turned for 0.400 s", 0.4)], ["3.00 s: why"])]
    assert len(troubles(bad)) == 3  # a stop, wheels that turned, and memory
    assert "| camera | black | 0.25 | 8 | 1 | 0.10 | 0.40 | 1.0 |" in report(bad)


def test_memory_is_judged_by_all_pieces_of_each_process():
    """Pieces of .1 h, of which the first ones load."""
    loads = [piece(n, 100.0 * n, []) for n in range(SETTLES)]
    saw = [piece(n, 700.0 + (40.0 if n % 2 else 0.0), []) for n in range(40)]
    assert growth(loads) is None
    assert growth([*loads, saw[0]]) is None
    assert growth([*loads, *saw[:2]]) == pytest.approx(400.0)
    assert abs(growth([*loads, *saw])) < 2.0  # the ends alone would say 10
    leaks = [made | {"megabytes": made["megabytes"] + 1.2 * n} for n, made in enumerate(saw)]
    assert growth([*loads, *leaks]) == pytest.approx(12.0, abs=2.0)
    assert "memory grew by" in troubles([*loads, *leaks])[0]
    # Another process begins with another memory.
    others = [made | {"process": "b", "megabytes": made["megabytes"] + 500.0} for made in [*loads, *leaks]]
    assert growth([*loads, *leaks, *others]) == pytest.approx(growth([*loads, *leaks]))


def test_a_piece_of_other_code_is_driven_again(tmp_path):
    file = tmp_path / "piece-0000.json"
    assert kept(file, {"code": "a"}) is None
    file.write_text(json.dumps({"key": {"code": "a"}, "seconds": 1}))
    assert kept(file, {"code": "a"})["seconds"] == 1
    assert kept(file, {"code": "b"}) is None
    file.write_text(file.read_text()[:-4])
    assert kept(file, {"code": "a"}) is None
    with pytest.raises(InputError, match="--piece 10 to 3600"):
        Soak(piece=1.0, out=tmp_path).run()


@pytest.mark.slow
def test_a_soak_goes_on_and_another_car_gets_a_folder_of_its_own(tmp_path, monkeypatch, capsys):
    driven = []

    def drive(config, number, seconds, note):
        driven.append((config.robot, number))
        return piece(number, 300.0, [row()])

    monkeypatch.setattr("ndtorch_robot.soak.piece.drive_piece", drive)
    monkeypatch.setattr(HostedBoard, "code", staticmethod(lambda: "board"))
    out = tmp_path / "soak"
    assert Soak(minutes=1.0, piece=60.0, out=out).run() == 0
    assert Soak(minutes=3.0, piece=60.0, out=out).run() == 0
    assert driven == [("maxston8", 0), ("maxston8", 1), ("maxston8", 2)]
    table = (out / "table.md").read_text()
    assert "pieces 3," in table
    # A shorter one drives nothing, and its table leaves nothing out.
    capsys.readouterr()
    assert Soak(minutes=1.0, piece=60.0, out=out, json=True).run() == 0
    assert json.loads(capsys.readouterr().out)["pieces"] == 3
    assert (out / "table.md").read_text() == table
    # Pieces of another length are another soak; the folder of the first one stays as it is.
    assert Soak(minutes=1.0, piece=30.0, out=out).run() == 0
    assert (out / "table.md").read_text() == table
    assert "pieces 2," in (tmp_path / "soak-2" / "table.md").read_text()
    # A soak that begins with another piece stands beside what was driven, and has buildings of its own.
    assert Soak(minutes=2.0, piece=60.0, first=7, out=out).run() == 0
    assert driven[-2:] == [("maxston8", 7), ("maxston8", 8)]
    assert "pieces 5," in (out / "table.md").read_text()
    # What is in a folder that no soak wrote stays too.
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "table.md").write_text("mine")
    assert Soak(minutes=0.5, piece=30.0, out=tmp_path / "mine").run() == 0
    assert (tmp_path / "mine" / "table.md").read_text() == "mine"
    assert (tmp_path / "mine-2" / "piece-0000.json").is_file()


def test_pieces_have_numbers_from_0(tmp_path):
    with pytest.raises(InputError, match="--first must be 0 to 999999, got -1"):
        Soak(first=-1, out=tmp_path / "soak").run()


def test_a_soak_that_is_stopped_tells_what_it_keeps(tmp_path, monkeypatch):
    def drive(config, number, seconds, note):
        if number:
            raise KeyboardInterrupt
        return piece(number, 300.0, [row()])

    monkeypatch.setattr("ndtorch_robot.soak.piece.drive_piece", drive)
    monkeypatch.setattr(HostedBoard, "code", staticmethod(lambda: "board"))
    with pytest.raises(Stopped, match=f"stopped; {tmp_path / 'soak'} keeps 1 of 3 pieces"):
        Soak(minutes=3.0, piece=60.0, out=tmp_path / "soak").run()
