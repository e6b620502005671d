"""The suite as on other machines: names, names that are joined, and what they set."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests import variants


def test_joined_names_hold_together(tmp_path: Path) -> None:
    names = variants.parts("no-vectors+old-blas+random-order+no-home")
    changed = variants.environment(names, tmp_path / "home", tmp_path)
    assert changed == {
        "ATEN_CPU_CAPABILITY": "default",
        "OPENBLAS_CORETYPE": "Prescott",
        "HOME": str(tmp_path / "home"),
        "TORCHINDUCTOR_CACHE_DIR": str(tmp_path / "compiled"),
    }
    assert variants.options(names, 7) == ["-p", "tests.shuffle", "--shuffle", "7"]
    assert variants.environment(["plain"], tmp_path, tmp_path) == {}
    assert variants.options(["plain"], 7) == []


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("avx3", "error: no variant 'avx3'; there are plain, random-order, "),
        ("avx2+nothing", "error: no variant 'nothing'; "),
        ("avx2+random-order+no-vectors", "two of these set ATEN_CPU_CAPABILITY"),
    ],
)
def test_names_that_are_none(name: str, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert variants.main([name]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


def test_turns_hold_every_variant() -> None:
    held = [name for turn in variants.TURNS for name in variants.parts(turn)]
    assert set(held) == set(variants.VARIANTS)
    assert "plain" in variants.TURNS


def test_the_workflow_fetches_all_commits() -> None:
    """A checkout of the last commit alone counts one, and would have the same turn for ever."""
    (workflow,) = (variants.ROOT / ".github" / "workflows").glob("*.yml")
    tests = workflow.read_text().split("\n  audit:")[0]
    assert tests.index("actions/checkout") < tests.index("fetch-depth: 0") < tests.index(".ci/run")


def test_pytest_runs_under_the_variant(tmp_path: Path) -> None:
    """With the variables set, SIGINT ignored, and a HOME that nobody can write to."""
    looked_at = tmp_path / "test_inside.py"
    looked_at.write_text(
        "import os, signal\n"
        "def test_variables():\n"
        "    assert os.environ['ATEN_CPU_CAPABILITY'] == 'avx2'\n"
        "    assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN\n"
        "    assert not os.access(os.environ['HOME'], os.W_OK)\n"
    )
    alone = ["-q", "-p", "no:cacheprovider", "--noconftest", "-c", str(tmp_path / "none.ini"), str(looked_at)]
    (tmp_path / "none.ini").write_text("[pytest]\n")
    assert variants.main(["avx2+no-interrupt+no-home", *alone]) == 0
    assert variants.main(["no-vectors+no-interrupt+no-home", *alone]) == 1
