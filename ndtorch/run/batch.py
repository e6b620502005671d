"""Runs of a binding model over one source, or over many: folders, a merged table, an index page, and what is done."""

from __future__ import annotations

import contextlib
import itertools
import json
import shutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from ndtorch.errors import InputError
from ndtorch.run.folder import RunFolder, make_writable
from ndtorch.run.options import BindJob, BindOptions, given
from ndtorch.run.result import RunResult, Watcher
from ndtorch.scenes.named import SCENES
from ndtorch.scenes.readers import IMAGE_SUFFIXES, VIDEO_SUFFIXES
from ndtorch.utils.files import read_text, replacing, write_text
from ndtorch.utils.workers import Event, run_tasks

INDEX, OUTCOME, RESPONSES = "index.html", "outcome.json", "responses.parquet"


def bind_source(
    job: BindJob,
    out: Path,
    name: str | None = None,
    *,
    force: bool = False,
    begin: Callable[[str, int | None], Callable[[int], object]] | None = None,
) -> tuple[RunResult, dict[str, Any], list[Path]]:
    """Run a model over a source and write everything into a folder, or nothing if it fails.

    Args:
        out, name: the run gets a folder of that name in `out`; without a name, named after its source.
        force: replace files that are there; else the folder gets a number.
        begin: called with the model in words and the number of frames; returns what is called for each chunk.

    Returns:
        The result, the contents of objects.json, and the files.
    """
    from ndtorch.report.exports import ResponseFile
    from ndtorch.report.films import EnhancedVideo, Film
    from ndtorch.report.page import folder_name, write_result
    from ndtorch.run.opening import prepare
    from ndtorch.run.run import picture_interval, run_model

    prepared = prepare(job)
    source, model = prepared.source, prepared.model
    folder = RunFolder(out / (name or folder_name(source.name)), force)
    work, film = folder.work, None
    watchers: list[Watcher] = []
    try:
        if find_spec("pyarrow") is not None:
            watchers.append(ResponseFile(work / RESPONSES, model))
        interval = picture_interval(model, source, job.pictures)
        if interval:
            rate = source.fps / interval
            if model.tracks:
                film = Film(work / "frames.mp4", rate, source.full_size)
            watchers.append(film or EnhancedVideo(work / "enhanced.mp4", rate, source.size))
        lengths = [source.length and source.length - prepared.start, prepared.most]
        total = min((one for one in lengths if one is not None), default=None)
        report = begin and begin(prepared.chosen, total)
        begun = (prepared.state, prepared.start, job.pictures)
        result = run_model(model, source, *begun, watchers, report, job.device, prepared.most)
        for watcher in watchers:
            watcher.close()
        found = write_result(result, prepared.about, work, prepared.chosen, film)
    except BaseException:
        folder.discard()
        raise
    return result, found, folder.publish()


@dataclass(frozen=True)
class Outcome:
    """What became of a source.

    Attributes:
        source: as it was named.
        folder: name of its folder, in that of all.
        error: why it was left out; empty if it was not.
        model: name of the model.
        objects: each in words.
        verdict, confidence: of the model at the end.
        seconds, wall_seconds: of the source, and how long they took.
    """

    source: str
    folder: str = ""
    error: str = ""
    model: str = ""
    objects: Sequence[str] = ()
    verdict: str = ""
    confidence: float | None = None
    seconds: float = 0.0
    wall_seconds: float = 0.0


def expanded(sources: Iterable[str]) -> list[str]:
    """Sources, each once; a folder without images of its own stands for the films and folders of images in it."""

    def has_images(folder: Path) -> bool:
        return folder.is_dir() and any(path.suffix.lower() in IMAGE_SUFFIXES for path in folder.glob("[!.]*"))

    every = dict[str, None]()
    for source in sources:
        folder = Path(source)
        inner = [] if source in SCENES or has_images(folder) else sorted(folder.glob("[!.]*"))
        films = [str(path) for path in inner if path.suffix.lower() in VIDEO_SUFFIXES or has_images(path)]
        every |= dict.fromkeys(films or [source])
    return list(every)


def bind_sources(
    sources: Sequence[str],
    folder: str | Path,
    options: BindOptions | None = None,
    *,
    jobs: int = 1,
    weights: bool = False,
    again: bool = False,
    report: Callable[[Outcome], object] | None = None,
) -> list[Outcome]:
    """Run a binding model over many sources, one after the other or side by side, and merge what they give.

    The folder gets a folder for each source, `responses.parquet` and `responses.csv` with the time courses of all,
    and `index.html`. A second call with the same options skips what is finished, by the `outcome.json` in its folder. A
    source that cannot be used is left out. After Ctrl-C the tables hold what was finished.

    Args:
        sources: scenes, files, folders, cameras; a folder of films stands for all of them.
        options: of every run.
        jobs: processes; with more than one, a script needs `if __name__ == "__main__":`.
        weights: whether the tables have the 100 weights, once a chunk of frames.
        again: run what is finished too.
        report: called with every outcome as it comes.

    Returns:
        What became of each source, in their order; some are missing after Ctrl-C.

    Raises:
        InputError: no source, or a folder that cannot be written.
    """
    import pyarrow  # noqa: F401  found missing before any time is spent

    options, folder, names = options or BindOptions(), Path(folder), expanded(sources)
    if not names:
        raise InputError("sources must be one or more")
    if options.resume is not None:
        raise InputError("--resume continues a run of one source; of several, repeat the command")
    make_writable(folder)
    earlier, kept, outcomes, tasks = finished(folder), list[Event](), dict[str, Outcome](), list[Task]()
    for name in names:
        job = BindJob(**vars(options), source=name)
        before = earlier.get(key := key_of(job))
        if before is None or again:
            tasks.append(Task(job, folder, key, before.folder if before else None))
        else:
            kept.append(Event("done", 0, before))
    try:
        events = (Event("done", n, run_one(task)) for n, task in enumerate(tasks))
        for _, n, value in itertools.chain(kept, events if jobs == 1 else run_tasks(run_one, tasks, jobs)):
            outcome = value if isinstance(value, Outcome) else Outcome(tasks[n].job.source, error=str(value))
            outcomes[outcome.source] = outcome
            if report is not None:
                report(outcome)
    finally:
        done = [outcomes[name] for name in names if name in outcomes]
        write_tables([one for one in done if not one.error], folder, weights)
        write_index(done, len(names), folder)
    return done


class Task(NamedTuple):
    """A run, the folder of all, what tells it from others, and the name of its own folder if it is run again."""

    job: BindJob
    folder: Path
    key: str
    into: str | None = None


def key_of(job: BindJob) -> str:
    """What tells a run from others: its options, and the state of its file, another one of which is another source."""
    path = Path(job.source)
    file = path.stat() if job.source not in SCENES and path.exists() else None
    stamp = [] if file is None else [file.st_size, file.st_mtime_ns]
    return json.dumps({**given(job, *asdict(job)), "file": stamp}, default=str)


def finished(folder: Path) -> dict[str, Outcome]:
    """The outcomes of earlier runs, by what tells each from others."""
    found = {}
    for path in folder.glob(f"*/{OUTCOME}"):
        with contextlib.suppress(OSError, TypeError, ValueError, LookupError):
            kept = json.loads(read_text(path))
            found[kept["key"]] = Outcome(**kept["outcome"])
    return found


def run_one(task: Task) -> Outcome:
    """Run one source; whatever is wrong with it is its error."""
    import torch

    from ndtorch.report.summary import words

    torch.set_num_threads(1)
    source = task.job.source
    try:
        result, _, files = bind_source(task.job, task.folder, task.into, force=task.into is not None)
    except Exception as error:  # a fault in one source is no reason to lose the others
        text = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
        return Outcome(source, error=text)
    own = files[0].parent
    if result.interrupted:
        shutil.rmtree(own)
        raise KeyboardInterrupt
    objects = list(map(words, result.objects))
    state = (result.verdict, result.confidence, result.simulated_seconds, result.wall_seconds)
    outcome = Outcome(source, own.name, "", result.model.name, objects, *state)
    write_text(own / OUTCOME, json.dumps({"key": task.key, "outcome": asdict(outcome)}))
    return outcome


def write_tables(outcomes: Sequence[Outcome], folder: Path, weights: bool) -> None:
    """responses.parquet and responses.csv: the rows of every run below one another, with their source."""
    import pyarrow
    import pyarrow.compute
    import pyarrow.csv
    import pyarrow.parquet

    from ndtorch.vision import FEATURES

    names = [name.replace("°", "deg") for name in FEATURES]
    pairs = [f"weight_{name}_from_{other}" for name in names for other in names]
    tables = []
    for one in outcomes:
        table = pyarrow.parquet.read_table(folder / one.folder / RESPONSES)
        table = table.add_column(0, "source", pyarrow.array([one.source] * len(table), pyarrow.string()))
        for k, name in enumerate(pairs if weights else ()):
            table = table.append_column(name, pyarrow.compute.list_element(table["weights"], k))
        tables.append(table.drop_columns(["weights"]))
    if tables:
        whole = pyarrow.concat_tables(tables)
        with replacing(folder / RESPONSES) as table_part, replacing(folder / "responses.csv") as csv_part:
            pyarrow.parquet.write_table(whole, table_part)
            pyarrow.csv.write_csv(whole, csv_part)


def write_index(outcomes: Sequence[Outcome], sources: int, folder: Path) -> None:
    """index.html: a row a source, with a link to its report."""
    from markupsafe import Markup

    from ndtorch.report.page import NAME, Table, write_page

    rows = []
    for one in outcomes:
        sure = "" if one.confidence is None else f"{one.confidence:.2f}"
        cells = [str(len(one.objects)), "; ".join(one.objects), one.verdict, sure, f"{one.seconds:.1f} s"]
        link = Markup('<a href="{}">{}</a>').format(quote(f"{one.folder}/{NAME}"), one.source)
        found = [link, one.model, *cells, f"{one.wall_seconds:.1f} s"]
        rows.append([one.source, "left out", "", one.error, *[""] * 4] if one.error else found)
    heads = ("source", "model", "objects", "", "verdict", "confidence", "length", "time taken")
    title = f"{sum(not one.error for one in outcomes)} of {sources} sources"
    answer = [f"Time courses of all: {RESPONSES}, responses.csv."]
    write_page(folder, title, answer, tables=[Table("Sources", heads, rows)], name=INDEX)
