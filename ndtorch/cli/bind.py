"""`ndtorch bind`: the objects in a scene or a video."""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import tyro

from ndtorch.cli.command_run import INCOMPLETE, INTERRUPTED
from ndtorch.run.options import BindJob


@dataclass(frozen=True)
class Bind(BindJob):
    """Find the objects in a scene or a video: their number and their features.

    Prints the objects and the verdict, and writes them, pictures, the learned state and report.html, which
    shows it all, into a folder.
    The model foreground, which is the default for files and cameras, finds objects over time: a timeline, boxes and an
    overlay.
    """

    source: Annotated[str, tyro.conf.Positional] = BindJob.source
    """Scene name (see `ndtorch scenes`), video file, folder of images, camera (`camera:0`, /dev/video0) or address."""
    out: Path = Path("out")
    """Folder for results; a run gets a new folder in it, named after its source: two-bars, then two-bars-2."""
    force: bool = False
    """Write into the folder named after the source even if results are there; files of the same names are replaced."""
    json: bool = False
    """Print one JSON object on stdout and nothing else."""
    open: bool = False
    """Show report.html in the browser when the run has ended."""

    def run(self) -> int:
        import torch

        from ndtorch.binding.models.whole_field import WholeFieldModel
        from ndtorch.report.exports import ResponseFile
        from ndtorch.report.films import EnhancedVideo, Film
        from ndtorch.report.page import NAME, folder_name, open_in_browser, write_result
        from ndtorch.report.summary import in_words
        from ndtorch.run.folder import RunFolder
        from ndtorch.run.opening import prepare
        from ndtorch.run.progress import progress_bar
        from ndtorch.run.result import Watcher
        from ndtorch.run.run import picture_interval, run_model
        from ndtorch.utils.tensors import tune_allocator

        # Programs choose; the library never does. Two threads get in each other's way on a busy machine.
        torch.set_num_threads(1)
        tune_allocator()
        prepared = prepare(self)
        source, model = prepared.source, prepared.model
        folder = RunFolder(self.out / folder_name(source.name), self.force)
        if not self.json:
            print(f"model  {prepared.chosen}", flush=True)
        work, film = folder.work, None
        watchers: list[Watcher] = []
        try:
            if isinstance(model, WholeFieldModel) and find_spec("pyarrow") is not None:
                watchers.append(ResponseFile(work / "responses.parquet"))
            interval = picture_interval(model, source, self.pictures)
            if interval:
                rate = source.fps / interval
                if model.tracks:
                    film = Film(work / "frames.mp4", rate, source.full_size)
                watchers.append(film or EnhancedVideo(work / "enhanced.mp4", rate, source.size))
            lengths = [source.length and source.length - prepared.start, prepared.most]
            total = min((one for one in lengths if one is not None), default=None)
            with progress_bar(total, self.json, unit=" frames", leave=False, mininterval=0.5) as bar:
                result = run_model(
                    model,
                    source,
                    prepared.state,
                    prepared.start,
                    self.pictures,
                    watchers,
                    bar.update,
                    self.device,
                    prepared.most,
                )
            for watcher in watchers:
                watcher.close()
            found = write_result(result, prepared.about, work, prepared.chosen, film)
        except BaseException:
            folder.discard()
            raise
        files = folder.publish()
        if self.json:
            print(json.dumps(found, ensure_ascii=False))
        else:
            print(in_words(result))
            print(f"written  {folder.final}: {', '.join(path.name for path in files)}")
        if self.open:
            open_in_browser(folder.final / NAME)
        if result.interrupted:
            return INTERRUPTED
        return INCOMPLETE if source.silent else 0
