"""The tool that changes the source: what it changes, whom it asks, and that it goes on where it was broken off."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.mutation import c_changes, forks, whom
from tests.mutation.change import Change
from tests.mutation.table import HEADER, UNASKED, Table, WrongTable, interval, sample_name
from tests.mutation.trial import Bench, Ended

ROOT = Path(__file__).parents[1]
C = """#define LIMIT 3 /* 1 < 2 */
static int f(int a, const int *p) {
    if (a <= 4) {
        a += *p * 2;
        stop("a > b");
    }
    return a;
}
"""


def changed(text: str) -> list[str]:
    """Every changed source, as the line that differs."""
    whole = [change.applied(text) for place in c_changes.places("f.c", text) for change in place]
    return [next(new for new, old in zip(w.splitlines(), text.splitlines(), strict=True) if new != old) for w in whole]


def test_changes_of_c() -> None:
    assert [line.strip() for line in changed(C)] == [
        "if (a < 4) {",
        "if (a > 4) {",
        "if (a <= 5) {",
        ";",
        "a -= *p * 2;",
        "a = *p * 2;",
        "a += *p / 2;",
        "a += *p * 3;",
        ";",
    ]


def test_a_change_says_what_it_is() -> None:
    text = "a = 1\nb  =  a < 2\n"
    change = Change("f.py", 2, text.index("<"), text.index("<") + 1, "<=", "operator")
    assert change.applied(text) == "a = 1\nb  =  a <= 2\n"
    assert change.shown(text) == "b = a < 2  ->  b = a <= 2"


@pytest.mark.parametrize(
    ("file", "asked"),
    [
        ("ndtorch/vision/temporal.py", ["tests/vision/test_temporal.py", "tests/also.py"]),
        ("ndtorch/navigation/features.py", ["tests/navigation/test_row_features.py"]),
        ("robot/ndtorch_robot/safety.py", ["tests/robot/test_safety.py", "tests/near.py"]),
    ],
)
def test_whom_it_asks(file: str, asked: list[str], tmp_path: Path) -> None:
    for name in (file, *asked):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    also = {"ndtorch": ["tests/not/there.py"], "ndtorch/vision": ["tests/also.py"], "robot": ["tests/near.py"]}
    assert whom.tests_of(file, tmp_path, also, 5) == asked


def test_after_the_mirrored_file_it_asks_those_that_use_most(tmp_path: Path) -> None:
    for name, text in {
        "ndtorch/vision/near.py": "def near(): ...\n\n\ndef unseen(): ...\n",
        "ndtorch/vision/above.py": "from ndtorch.vision.near import near\n",
        "ndtorch/vision/other.py": "near = 1\n",
        "tests/vision/test_near.py": "from ndtorch.vision.near import near\n",
        "tests/vision/test_above.py": "",
        "tests/vision/test_a.py": "from ndtorch.vision import (\n    near,\n)\n\nnear()\n",
        "tests/vision/test_b.py": "from ndtorch.vision import far, near\n\nnear()\nnear()\n",
        "tests/vision/test_c.py": "import ndtorch.vision.near\n",
        "tests/vision/test_d.py": "from ndtorch.scenes import near\n\nnear()\n",
        "tests/vision/test_e.py": "def near(): ...\n",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    names = [f"tests/vision/test_{name}.py" for name in ("near", "c", "b", "a", "above")]
    assert whom.tests_of("ndtorch/vision/near.py", tmp_path, {}, 9) == names
    assert whom.tests_of("ndtorch/vision/near.py", tmp_path, {}, 2) == names[:3]


def test_a_table_goes_on_where_it_was(tmp_path: Path) -> None:
    path, name = tmp_path / "out" / "t.tsv", sample_name(1, {"a.py": "x"}, [])
    table = Table(path, name)
    table.put(1, "noticed", "a.py:3", "kind", "a\tb  ->  c")
    table.put(0, UNASKED, "a.py:4", "kind", "d  ->  e")
    table.put(2, "does not compile", "a.py:5", "kind", "f  ->  g")
    assert path.read_text().splitlines()[:3] == [name, HEADER, f"0\t{UNASKED}\ta.py:4\tkind\td  ->  e"]
    with path.open("a") as file:
        file.write("3\tnoti")
    again = Table(path, name)
    assert [again.outcome(n) for n in range(4)] == [UNASKED, "noticed", "does not compile", None]
    assert again.counts() == (1, 2)
    assert "noti\n" not in path.read_text()


def test_a_table_of_another_sample_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "t.tsv"
    names = {sample_name(*given) for given in [(1, {"a": "x"}, []), (2, {"a": "x"}, []), (1, {"a": "y"}, [])]}
    assert len(names) == 3
    Table(path, min(names)).put(0, "noticed", "a:1", "kind", "x")
    before = path.read_bytes()
    with pytest.raises(WrongTable, match="another sample"):
        Table(path, max(names))
    assert path.read_bytes() == before


def test_the_interval_of_a_share() -> None:
    assert interval(0, 0) == (0.0, 1.0)
    # Newcombe 1998, table I: 81 of 263, 15 of 148 and 0 of 20.
    assert interval(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert interval(15, 148) == pytest.approx((0.0624, 0.1605), abs=1e-4)
    assert interval(0, 20) == pytest.approx((0.0, 0.1611), abs=1e-4)


SETTINGS: dict[str, Any] = {"also": {}, "marks": "", "preload": ["pytest"], "patience": 5, "wider": 5, "longest": 3}


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Of a project that is one line."""
    root = tmp_path / "checkout"
    files = {
        "ndtorch/near.py": "def near(a):\n    return a < 2\n",
        "ndtorch/__init__.py": "",
        "tests/test_near.py": "from ndtorch.near import near\n\n\ndef test_it():\n    assert near(1)\n",
        "tests/test_more.py": "from ndtorch.near import near\n\n\ndef test_it():\n    assert not near(2)\n",
        "tests/test_slow.py": "def test_it():\n    while True:\n        pass\n",
        "tests/test_bad.py": "def test_it():\n    assert False\n",
        "pyproject.toml": "[tool.pytest.ini_options]\naddopts = '--import-mode=importlib'\n",
        "ignored.txt": "",
        ".gitignore": "ignored.txt\n",
    }
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    subprocess.run(["git", "init", "-q", root], check=True)
    return root


def less_to(new: str) -> Change:
    text = "def near(a):\n    return a < 2\n"
    return Change("ndtorch/near.py", 2, text.index("<"), text.index("<") + 1, new, "operator")


def test_a_change_is_tried_in_a_copy(checkout: Path, tmp_path: Path) -> None:
    settings = {
        "also": {"ndtorch": ["tests/test_more.py"]},
        "marks": "",
        "preload": ["pytest"],
        "patience": 5,
        "wider": 5,
        "longest": 40,
    }
    folder = tmp_path / "tree"
    with Bench(checkout, folder, sys.executable, settings, mirrored=True) as bench:
        assert not (folder / "ignored.txt").exists()
        assert bench.try_change(less_to(">")) == "noticed"
        assert bench.try_change(less_to("<=")) == "survived the mirrored file"
        bench.mirrored = False
        assert bench.try_change(less_to("<="), begin=1) == "noticed: wider list"
        assert bench.try_change(less_to("<  ")) == "survived"
        assert (folder / "ndtorch/near.py").read_text() == (checkout / "ndtorch/near.py").read_text()


def test_only_what_fails_with_the_change_is_run_without_it(
    checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (checkout / "tests/test_near.py").write_text(
        "from ndtorch.near import near\n\n\ndef test_it():\n    assert near(1)\n\n\ndef test_no():\n    assert False\n"
    )
    settings = SETTINGS | {"also": {"ndtorch": ["tests/test_more.py", "tests/test_bad.py"]}, "longest": 40}
    with Bench(checkout, tmp_path / "tree", sys.executable, settings) as bench:
        ran: list[str] = []
        run = bench.run

        def watched(command: Sequence[str], cpu: float, wall: float) -> Ended:
            ran.append(command[-1])
            return run(command, cpu, wall)

        monkeypatch.setattr(bench, "run", watched)
        assert bench.try_change(less_to(">")) == "noticed"
        assert ran == ["tests/test_near.py", "tests/test_near.py::test_it"]
        with pytest.raises(RuntimeError, match="fail without any change"):
            bench.try_change(less_to("<="))
        ran.clear()
        assert bench.try_change(less_to("<="), begin=1) == "noticed: wider list"
        assert ran == ["tests/test_more.py"] * 2
        assert bench.try_change(less_to("<  "), begin=1) == "survived"
        assert ran[2:] == ["tests/test_more.py"] + ["tests/test_bad.py"] * 2


def test_tests_that_fail_by_themselves_say_nothing(checkout: Path, tmp_path: Path) -> None:
    (checkout / "tests/test_near.py").write_text("def test_it():\n    assert False\n")
    with (
        Bench(checkout, tmp_path / "tree", sys.executable, SETTINGS) as bench,
        pytest.raises(RuntimeError, match="fail without any change"),
    ):
        bench.try_change(less_to(">"))


@pytest.mark.parametrize("there", [True, False])
def test_firmware_is_asked_on_a_board_too_where_there_is_a_compiler_for_it(
    there: bool, checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: name if there else None)
    asked = Bench(checkout, tmp_path / "tree", sys.executable, SETTINGS).commands("robot/firmware/drive.c")
    assert ["test-board" in command[-1] for command in asked] == [False, False, True][: 2 + there]


def test_programs_that_fail_by_themselves_say_nothing_of_firmware(checkout: Path, tmp_path: Path) -> None:
    """As `make test-board` does where there is no simulator."""
    (checkout / "near.c").write_text("int near;\n")
    change = Change("near.c", 1, 4, 8, "far", "name")
    with Bench(checkout, tmp_path / "tree", sys.executable, SETTINGS) as bench:
        bench.commands = lambda file: [("grep", "int", file), ("false",)]  # type: ignore[method-assign]
        assert bench.try_change(change) == "survived"
        bench.commands = lambda file: [("grep", "int", file), ("false",), ("grep", "near", file)]  # type: ignore[method-assign]
        assert bench.try_change(change) == "noticed: wider list"


def test_what_takes_too_long_is_ended(tmp_path: Path) -> None:
    (tmp_path / "test_busy.py").write_text("def test_it():\n    while True:\n        pass\n")
    (tmp_path / "test_idle.py").write_text("import time\n\n\ndef test_it():\n    time.sleep(60)\n")
    asked = [
        {"arguments": ["-q", "test_busy.py"], "cpu": 1, "wall": 60},
        {"arguments": ["-q", "test_idle.py"], "cpu": 60, "wall": 1},
    ]
    done = subprocess.run(
        [sys.executable, forks.__file__],
        input="".join(json.dumps(line) + "\n" for line in asked),
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    busy, idle = (json.loads(line) for line in done.stdout.splitlines())
    assert busy["status"] is None
    assert idle["status"] is None
    assert busy["cpu"] > idle["cpu"]


@pytest.mark.long
def test_a_file_that_is_too_slow_for_one_list_is_asked_where_it_is_the_mirrored_one(
    checkout: Path, tmp_path: Path
) -> None:
    slow = "from ndtorch.near import near\n\n\ndef test_it():\n    import time\n\n    end = time.process_time() + 1.5\n"
    (checkout / "tests/test_near.py").write_text(
        slow + "    while time.process_time() < end:\n        pass\n    assert not near(2)\n"
    )
    with Bench(checkout, tmp_path / "tree", sys.executable, SETTINGS) as bench:
        command = bench.commands("ndtorch/near.py")[0]
        assert bench.unchanged(command, 1).status is None
        assert bench.try_change(less_to("<=")) == "noticed"
