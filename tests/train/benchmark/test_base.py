"""The base of all benchmarks: rows are kept, tasks run in parallel, tables show the best."""

from __future__ import annotations

import functools
from pathlib import Path

from ndtorch_train.benchmark.base import Benchmark, Column, Task
from ndtorch_train.rows import Row

COLUMNS = (Column("case", "case"), Column("method", "method"), Column("f", "F", 2, "f_se", better=1), Column("n", "n"))


def work(name: str, value: float | None, folder: Path) -> list[Row]:
    with (folder / "runs").open("a") as file:
        file.write(name)
    if name == "d":
        raise ValueError("of no use")
    return [{"case": "one", "method": name, "f": value, "f_se": 0.0, "n": 3}]


def made(names: str) -> Benchmark:
    tasks = [Task(name, functools.partial(work, name, n / 4)) for n, name in enumerate(names)]
    return Benchmark("toy", "Toys", "A note.", COLUMNS, tasks, ("ndtorch.errors",))


def test_the_best_of_a_case_is_bold_and_what_is_missing_is_a_dash(tmp_path: Path) -> None:
    rows, text, folder, failed = made("abc").run(tmp_path / "out", 1, False, False, print)
    assert [row["f"] for row in rows] == [0.0, 0.25, 0.5]
    assert "| one | c | **0.50 ± 0.00** | 3 |" in text
    assert Column("g", "G").cell({"g": None}) == "-"
    assert (folder / "toy.csv").read_text().splitlines()[:2] == ["case,method,f,f_se,n", "one,a,0,0,3"]
    assert (folder / "report.html").is_file()
    assert not failed


def test_finished_rows_are_kept_and_other_tasks_get_a_folder_of_their_own(tmp_path: Path) -> None:
    out = tmp_path / "out"
    first = made("ab").run(out, 1, False, False, print)
    again = made("ab").run(out, 1, False, False, print)
    assert again[:3] == first[:3]
    assert (out / "runs").read_text() == "ab"
    (out / "rows.jsonl").write_text((out / "rows.jsonl").read_text()[:-9])  # the last line was cut off
    assert made("ab").run(out, 1, False, False, print).rows == first.rows
    assert (out / "runs").read_text() == "abb"
    assert made("abc").run(out, 1, False, False, print).folder == tmp_path / "out-2"


def test_tasks_run_in_parallel_and_failures_leave_the_others(tmp_path: Path) -> None:
    rows, _, _, failed = made("abd").run(tmp_path / "out", 2, False, False, print)
    assert [row["method"] for row in rows] == ["a", "b"]
    assert list(failed) == ["d"]
    assert "of no use" in failed["d"]
