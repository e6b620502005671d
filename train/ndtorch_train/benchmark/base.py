"""The base of all benchmarks: tasks run in parallel, their rows are kept as they come, one table is written."""

from __future__ import annotations

import functools
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from ndtorch.errors import InputError, did_you_mean
from ndtorch.utils.workers import run_tasks

if TYPE_CHECKING:
    from ndtorch.report.page import Shown

Split = Literal["tune", "test"]
"""Choose constants on the one, report the other: their seeds have none in common."""

BAR = "\\|"
"""A bar in a cell of a Markdown table."""

Row = dict[str, Any]
"""Values by name, fit for JSON; None where there is none."""


class Task(NamedTuple):
    """One method on one case.

    Attributes:
        key: its name among the tasks of its benchmark.
        work: returns its rows; it may write images into the folder it gets. A `functools.partial` of a function of a
            module's top level, so that another process can run it.
    """

    key: str
    work: Callable[[Path], list[Row]]


class Column(NamedTuple):
    """A column of the table: its key in the rows, its head, decimals of floats, and whether the highest (1) or the
    lowest (-1) value of a case is the best."""

    key: str
    head: str
    digits: int = 2
    better: int = 0

    def cell(self, row: Row) -> str:
        """The value as the table shows it."""
        value = row.get(self.key)
        if value is None:
            return "-"
        return f"{value:.{self.digits}f}" if isinstance(value, float) else str(value)


@dataclass(frozen=True)
class Benchmark:
    """A measurement and its table.

    Attributes:
        name: of the command; title and note: of the table.
        columns: of the table; the first names the case, whose best values are bold.
        tasks: in the order of the table.
        summary: rows that are computed from all others and are shown below them.
        draw: writes images of the rows into a folder.
        settings: options on which the rows depend besides the names of the tasks.
    """

    name: str
    title: str
    note: str
    columns: Sequence[Column]
    tasks: Sequence[Task]
    summary: Callable[[list[Row]], list[Row]] = lambda rows: []
    draw: Callable[[list[Row], Path], list[Shown]] = lambda rows, folder: []
    settings: Mapping[str, Any] = field(default_factory=dict)

    def run(self, folder: Path, jobs: int, fresh: bool, report: Callable[[str], None]) -> BenchmarkResult:
        """Run the tasks that have no rows in this folder yet, and write all files.

        Rows of other settings are not used: the folder begins anew.
        """
        from ndtorch.report.page import versions

        settings = {"benchmark": self.name, **self.settings, **versions("ndtorch-train")}
        settings = json.loads(json.dumps(settings, default=str))
        file, kept, failed = folder / "rows.jsonl", dict[str, list[Row]](), dict[str, str]()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() and not fresh else []
            if lines and json.loads(lines[0]) == settings:
                # The last line may have been cut off.
                kept = dict(json.loads(line) for line in lines[1:] if line.endswith("]]"))
            text = [json.dumps(settings), *(json.dumps(pair) for pair in kept.items())]
            file.write_text("\n".join(text) + "\n", encoding="utf-8")
            todo = [task for task in self.tasks if task.key not in kept]
            for key, rows, why in self._results(todo, jobs, folder):
                if rows is None:
                    failed[key] = why
                    continue
                kept[key] = rows
                with file.open("a", encoding="utf-8") as end:
                    end.write(json.dumps([key, rows]) + "\n")
                report(f"{key}: done")
            every = [row for task in self.tasks for row in kept.get(task.key, ())]
            return BenchmarkResult(every, self._write(every, folder), folder, failed)
        except OSError as error:
            raise InputError(f"{error.filename or folder} cannot be written: {error.strerror or error}") from None

    def _results(self, todo: Sequence[Task], jobs: int, folder: Path) -> Iterator[tuple[str, list[Row] | None, str]]:
        if min(jobs, len(todo)) == 1:  # in this process: another would only cost its start
            for task in todo:
                yield task.key, _work(task, folder=folder), ""
            return
        for kind, index, value in run_tasks(functools.partial(_work, folder=folder), todo, jobs):
            yield todo[index].key, value if kind == "done" else None, str(value).strip()

    def _write(self, rows: list[Row], folder: Path) -> str:
        """Write NAME.csv, NAME.md, images and report.html; returns the text to print."""
        import pandas

        from ndtorch.report.page import Table, write_page

        columns = [column.key for column in self.columns]
        pandas.DataFrame(rows, columns=columns).to_csv(folder / f"{self.name}.csv", index=False, float_format="%.6g")
        every, case, lines = [*rows, *self.summary(rows)], self.columns[0].key, []
        for row in every:
            rivals, line = [other for other in every if other[case] == row[case]], []
            for column in self.columns:
                values = [column.better * v for other in rivals if (v := other.get(column.key)) is not None]
                best = column.better and values and row.get(column.key) == column.better * max(values)
                line.append(f"**{column.cell(row)}**" if best and len(rivals) > 1 else column.cell(row))
            lines.append(line)
        heads = [column.head for column in self.columns]
        text = f"{self.note}\n\n" + "\n".join(
            f"| {' | '.join(cell.replace('|', BAR) for cell in line)} |"
            for line in (heads, ["---"] * len(heads), *lines)
        )
        (folder / f"{self.name}.md").write_text(text + "\n", encoding="utf-8")
        table = Table("Results", heads, [[cell.strip("*") for cell in line] for line in lines])
        shown = self.draw(rows, folder) if rows else []
        write_page(folder, self.title, [self.note], tables=[table], shown=shown, used=["ndtorch-train"])
        return text


class BenchmarkResult(NamedTuple):
    """Rows, the text to print, the folder of the files, and why tasks failed."""

    rows: list[Row]
    text: str
    folder: Path
    failed: dict[str, str]

    def report(self, as_json: bool) -> int:
        """Print; returns the exit code."""
        files = ", ".join(sorted(file.name for file in self.folder.iterdir()))
        print(json.dumps(self.rows) if as_json else f"{self.text}\n\nwritten  {self.folder}: {files}")
        for key, why in self.failed.items():
            print(f"error: {key} failed: {why}", file=sys.stderr)
        return 1 if self.failed else 0


def _work(task: Task, *, folder: Path) -> list[Row]:
    """One task, in any process, with one thread."""
    import cv2
    import torch

    from ndtorch.utils.tensors import tune_allocator

    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    tune_allocator()
    return task.work(folder)


def means(rows: Sequence[Row], columns: Sequence[Column]) -> Row:
    """The mean of each column over the rows that have a value; None without any."""
    values = {c.key: [float(row[c.key]) for row in rows if row[c.key] is not None] for c in columns}
    return {key: sum(each) / len(each) if each else None for key, each in values.items()}


def known(option: str, names: Sequence[str], allowed: Sequence[str]) -> None:
    """Raise `InputError` for names that are not allowed."""
    for name in names:
        if name not in allowed:
            raise InputError(f"{option} must be among {', '.join(allowed)}, got {name!r}{did_you_mean(name, allowed)}")
    if not names:
        raise InputError(f"{option} must name at least one of {', '.join(allowed)}")
