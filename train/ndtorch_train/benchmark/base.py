"""The base of all benchmarks: tasks run in parallel, their rows are kept as they come, one table is written."""

from __future__ import annotations

import csv
import functools
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from ndtorch.errors import InputError, did_you_mean
from ndtorch.run.folder import place_for
from ndtorch.utils.files import replacing, write_text
from ndtorch.utils.packages import code_digest
from ndtorch.utils.signals import parts_kept
from ndtorch.utils.workers import Report, run_tasks
from ndtorch_train.rows import Row, RowStore

if TYPE_CHECKING:
    from ndtorch.report.page import Shown

Split = Literal["tune", "test"]
"""Choose constants on the one, report the other: their seeds have none in common."""


class Task(NamedTuple):
    """One method on one case.

    Attributes:
        key: names it among the tasks of its benchmark.
        work: gives its rows; it may write images into the folder it gets. A `functools.partial` of a function of a
            module's top level, so that another process can run it.
    """

    key: str
    work: Callable[[Path], list[Row]]


class Column(NamedTuple):
    """A column of the table: its key in the rows, its head, decimals of floats, the key of its standard error, and
    whether the highest (1) or the lowest (-1) value of a case is the best."""

    key: str
    head: str
    digits: int = 2
    error: str = ""
    better: int = 0

    def cell(self, row: Row) -> str:
        """The value as the table shows it."""
        value = row.get(self.key)
        if value is None:
            return "-"
        if isinstance(value, bool):
            return "yes" if value else "no"
        if not isinstance(value, float):
            return str(value)
        text = f"{value:.{self.digits}f}"
        return f"{text} ± {row[self.error]:.{self.digits}f}" if self.error else text


@dataclass(frozen=True)
class Benchmark:
    """What is measured, and how it is shown.

    Attributes:
        name: of the command; title and note: of the table.
        columns: of the table; the first two name the case and the method.
        tasks: in the order of the table.
        uses: modules whose code the rows depend on.
        summary: rows that are computed from all others and are shown below them.
        draw: writes images of the rows into a folder.
        pivot: keys of the values to show in a table with a row a case and a column a method; empty: a row each.
        settings: what the rows depend on besides the names of the tasks.
    """

    name: str
    title: str
    note: str
    columns: Sequence[Column]
    tasks: Sequence[Task]
    uses: Sequence[str]
    summary: Callable[[list[Row]], list[Row]] = lambda rows: []
    draw: Callable[[list[Row], Path], list[Shown]] = lambda rows, folder: []
    pivot: Sequence[str] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)

    def run(self, out: Path, jobs: int, fresh: bool, force: bool, tell: Callable[[str], None]) -> Result:
        """Run what has not been run in this folder with these options and this code, and write all files."""
        keys = [task.key for task in self.tasks]
        code = code_digest(("ndtorch_train.benchmark", *self.uses))[:12]
        settings = {"command": f"benchmark {self.name}", "code": code, "tasks": keys, **self.settings}
        folder = place_for(out, settings, fresh, force).folder
        store = RowStore(folder / "rows.jsonl")
        failed: dict[str, str] = {}
        try:
            todo = [task for task in self.tasks if task.key not in store.rows]
            with parts_kept(folder, "results", len(keys), lambda: len(store.rows)):
                for key, rows, why in self._results(todo, jobs, folder):
                    if rows is None:
                        failed[key] = why
                    else:
                        store.add({key: rows})
                        tell(f"{key}: done")
            found = [row for key in keys for row in store.rows.get(key, ())]
            return Result(found, self._write(found, folder), folder, failed)
        except OSError as error:
            raise InputError(f"{error.filename or folder} cannot be written: {error.strerror or error}") from None

    def _results(self, todo: Sequence[Task], jobs: int, folder: Path) -> Iterator[tuple[str, list[Row] | None, str]]:
        if min(jobs, len(todo)) == 1:  # in this process: another would only cost its start
            for task in todo:
                yield task.key, _work(task, lambda share: None, folder=folder), ""
            return
        for kind, index, value in run_tasks(functools.partial(_work, folder=folder), todo, jobs):
            if kind in ("done", "failed"):
                yield todo[index].key, value if kind == "done" else None, str(value).strip()

    def _write(self, rows: list[Row], folder: Path) -> str:
        """Write NAME.csv, NAME.md, images and report.html; returns the text to print."""
        from ndtorch.report.page import Page, Table, command_line, versions

        every = [*rows, *self.summary(rows)]
        keys = [key for column in self.columns for key in (column.key, column.error) if key]
        with replacing(folder / f"{self.name}.csv") as path, path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(keys)
            writer.writerows([_plain(row.get(key)) for key in keys] for row in rows)
        heads, cells = self._pivoted(every) if self.pivot else self._listed(every)
        text = f"{self.note}\n\n{markdown(heads, cells)}"
        write_text(folder / f"{self.name}.md", text)
        table = Table("Scores", heads, [[cell.strip("*") for cell in line] for line in cells])
        shown = self.draw(rows, folder) if rows else []
        facts = versions("ndtorch-train", "scikit-learn")
        Page(self.title, [self.note], command_line(), facts, [table], shown).write(folder)
        return text

    def _listed(self, rows: list[Row]) -> tuple[list[str], list[list[str]]]:
        lines = []
        case = self.columns[0].key
        for row in rows:
            rivals = [other for other in rows if other[case] == row[case]]
            line = []
            for column in self.columns:
                values = [v for other in rivals if (v := other.get(column.key)) is not None]
                best = column.better and values and row.get(column.key) == max(values, key=lambda v: column.better * v)
                line.append(f"**{column.cell(row)}**" if best and len(rivals) > 1 else column.cell(row))
            lines.append(line)
        return [column.head for column in self.columns], lines

    def _pivoted(self, rows: list[Row]) -> tuple[list[str], list[list[str]]]:
        case, method = (column.key for column in self.columns[:2])
        shown = [column for column in self.columns if column.key in self.pivot]
        methods = list(dict.fromkeys(row[method] for row in rows))
        at = {
            (row[case], row[method]): ", ".join(c._replace(error="", digits=2).cell(row) for c in shown) for row in rows
        }
        cases = list(dict.fromkeys(row[case] for row in rows))
        lines = [[str(one), *(at.get((one, name), "-") for name in methods)] for one in cases]
        return [", ".join(column.head for column in shown), *methods], lines


class Result(NamedTuple):
    """Rows, the text to print, the folder of the files, and why tasks failed."""

    rows: list[Row]
    text: str
    folder: Path
    failed: dict[str, str]

    def report(self, as_json: bool, show: bool) -> int:
        """Print; returns the exit code."""
        from ndtorch.report.page import NAME, open_in_browser

        if as_json:
            print(json.dumps(self.rows))
        else:
            files = ", ".join(sorted(file.name for file in self.folder.iterdir() if file.suffix != ".json"))
            print(f"{self.text}\nwritten  {self.folder}: {files}")
        if show:
            open_in_browser(self.folder / NAME)
        for key, why in self.failed.items():
            print(f"error: {key} failed: {why}", file=sys.stderr)
        return 1 if self.failed else 0


def _work(task: Task, report: Report, *, folder: Path) -> list[Row]:
    """One task, in any process, with one thread."""
    import cv2
    import torch

    from ndtorch.utils.tensors import tune_allocator

    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    tune_allocator()
    return task.work(folder)


def _plain(value: Any) -> Any:
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else value


def markdown(heads: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """A table."""
    every = [heads, ["---"] * len(heads), *lines]
    return "\n".join(f"| {' | '.join(line)} |" for line in every) + "\n"


def known(option: str, names: Sequence[str], allowed: Sequence[str]) -> None:
    """Check names against those that there are."""
    for name in names:
        if name not in allowed:
            raise InputError(f"{option} must be among {', '.join(allowed)}, got {name!r}{did_you_mean(name, allowed)}")
    if not names:
        raise InputError(f"{option} must name at least one of {', '.join(allowed)}")
