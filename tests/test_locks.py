"""The lock files hold all that the distributions need, at the versions that were tested, each with its hashes."""

import importlib.util
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ENTRY = re.compile(r"^([a-z0-9-]+)(?:\[[a-z,]+\])?==([^ ;]+)", re.MULTILINE)


def maker(file="make.py"):
    spec = importlib.util.spec_from_file_location(file.removesuffix(".py"), ROOT / "requirements" / file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


MAKE = maker()
LOCKS = MAKE.locks()


def test_there_is_one_for_each_extra_and_no_other():
    assert {path.stem for path in (ROOT / "requirements").glob("*.txt")} == set(LOCKS)
    assert {"ndtorch", "ndtorch-dev", "ndtorch-robot-sim", "ndtorch-train-peers"} <= set(LOCKS)
    assert "mujoco" in {MAKE.name_of(need) for need in LOCKS["ndtorch-train"]}  # by the robot's extra


@pytest.mark.parametrize("name", LOCKS)
def test_a_lock_is_whole(name):
    text = (ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8")
    locked = dict(ENTRY.findall(text))
    assert {MAKE.name_of(need) for need in LOCKS[name]} <= set(locked), "make lock"
    pinned = dict(ENTRY.findall((ROOT / "constraints.txt").read_text(encoding="utf-8")))
    assert {k: v for k, v in locked.items() if k in pinned} == {k: pinned[k] for k in locked if k in pinned}
    blocks = re.split(r"^(?=[a-z])", text, flags=re.MULTILINE)[1:]
    assert [block for block in blocks if not re.search(r"--hash=sha256:[0-9a-f]{64}", block)] == []
    assert "://" not in text  # from whatever index
    assert not {"torch", "torchvision"} & set(locked)


AUDIT = maker("audit.py")
GOOD = {"name": "a", "version": "1", "vulns": []}
HOLE = {"name": "b", "version": "2", "vulns": [{"id": "CVE-1"}]}
UNKNOWN = {"name": "c", "skip_reason": "not found"}


def test_what_was_not_looked_up_is_no_good_news():
    assert AUDIT.verdict([GOOD, GOOD]) == (0, ["no known holes in 1 packages"])
    assert AUDIT.verdict([GOOD, HOLE]) == (1, ["b 2: CVE-1"])
    missing = "error: 1 of 2 packages were not looked up, the first because: not found"
    assert AUDIT.verdict([GOOD, UNKNOWN]) == (2, [missing])
    assert AUDIT.verdict([HOLE, UNKNOWN]) == (1, ["b 2: CVE-1", missing])


def test_a_tool_that_breaks_is_told_in_one_line(capsys):
    broken = [sys.executable, "-c", "import sys; sys.exit('Traceback\\nno way out')"]
    assert AUDIT.main(broken) == 2
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 1
    assert said[0].endswith("no way out")
