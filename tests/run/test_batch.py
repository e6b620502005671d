"""Many sources: what is left out, what is not done again, and the merged table."""

from __future__ import annotations

import csv
import os
import shutil
from pathlib import Path

import pytest

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch.run.batch import Outcome, bind_sources
from ndtorch.run.options import BindOptions
from tests.command_line import refused

SHORT = BindOptions(model="published", seconds=0.2, pictures=0.0)


@pytest.fixture
def films(clip: Path, tmp_path: Path) -> Path:
    """A folder of two films and one that is none."""
    folder = tmp_path / "films"
    folder.mkdir()
    for name in ("a.avi", "b.avi"):
        shutil.copy(clip, folder / name)
    (folder / "broken.avi").write_bytes(os.urandom(3000))
    return folder


@pytest.mark.usefixtures("undrawn")
def test_bad_sources_are_left_out_and_finished_ones_are_not_done_again(films: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    sources, out = [str(films), "rings"], tmp_path / "out" / "batch"

    def stop(outcome: Outcome) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        bind_sources(sources, out, SHORT, report=stop)
    assert set(parquet.read_table(out / "responses.parquet")["source"].to_pylist()) == {str(films / "a.avi")}
    first = (out / "a" / "report.html").stat().st_mtime_ns
    done = bind_sources(sources, out, SHORT, weights=True)
    assert (out / "a" / "report.html").stat().st_mtime_ns == first
    names = [str(films / name) for name in ("a.avi", "b.avi", "broken.avi")]
    assert [one.source for one in done] == [*names, "rings"]
    assert [bool(one.error) for one in done] == [False, False, True, False]
    table = parquet.read_table(out / "responses.parquet").to_pydict()
    parts = [parquet.read_table(out / one.folder / "responses.parquet").to_pydict() for one in done if one.folder]
    for name in ("time", "input_red", "output_0deg", "count", "objects"):
        assert table[name] == [value for part in parts for value in part[name]]
    last = [row[12] for part in parts for row in part["weights"] if row is not None]
    assert [value for value in table["weight_right_from_down"] if value is not None] == last
    with (out / "responses.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["input_red"]) for row in rows] == pytest.approx(table["input_red"], rel=1e-6)
    page = (out / "index.html").read_text()
    assert 'href="rings/report.html"' in page
    assert "broken.avi</td><td>left out" in page
    # A file that has changed is another source.
    os.utime(films / "b.avi")
    asked = ["--model", "published", "--seconds", "0.2", "--pictures", "0", "--out", str(tmp_path / "out")]
    assert main(["bind", *sources, *asked]) == 1
    assert (out / "a" / "report.html").stat().st_mtime_ns == first
    assert sorted(path.name for path in out.iterdir() if path.is_dir()) == ["a", "b", "b-2", "rings"]


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
def test_processes_side_by_side(films: Path, tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    asked = [str(films), "--jobs", "2", "--model", "published", "--seconds", "0.2", "--pictures", "0"]
    assert main(["bind", *asked, "--out", str(tmp_path)]) == 1
    assert sorted(path.name for path in (tmp_path / "batch").iterdir() if path.is_dir()) == ["a", "b"]


def test_any_key_of_a_model_can_be_set(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from ndtorch.run.opening import prepare
    from ndtorch.run.options import BindJob

    model = prepare(BindJob(source=str(clip), model="published", set=("network.gamma=0.3", "border=wrap"))).model
    assert (model.config.network.gamma, model.config.border) == (0.3, "wrap")
    for setting, words in (("network.gama=1", "network.gamma?"), ("gamma=high", "gamma"), ("gamma", "KEY=VALUE")):
        refused(["bind", str(clip), "--model", "published", "--set", setting, "--out", str(tmp_path)], capsys, words)
    with pytest.raises(InputError, match="--resume"):
        bind_sources(["rings"], tmp_path, BindOptions(resume=tmp_path))
