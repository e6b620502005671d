"""`ndtorch bind`: the objects in a scene or a video."""

from __future__ import annotations

import json
import sys
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
    rrd: Path | None = None
    """Recording for the rerun viewer to write."""

    def run(self) -> int:
        import torch

        from ndtorch.binding.models.whole_field import WholeFieldModel
        from ndtorch.report.exports import ResponseFile, TimelineFile
        from ndtorch.report.films import EnhancedVideo, Gallery, Overlay
        from ndtorch.report.page import NAME, folder_name, open_in_browser, write_result
        from ndtorch.report.recording import Recording, why_not_whole
        from ndtorch.report.summary import in_words, summary
        from ndtorch.report.tracks import MaskStore
        from ndtorch.run.folder import RunFolder, new_file
        from ndtorch.run.opening import prepare
        from ndtorch.run.progress import progress_bar
        from ndtorch.run.result import Watcher
        from ndtorch.run.run import run_model
        from ndtorch.utils.tensors import tune_allocator

        # Programs choose; the library never does. Two threads get in each other's way on a busy machine.
        torch.set_num_threads(1)
        tune_allocator()
        prepared = prepare(self)
        source, model = prepared.source, prepared.model
        if self.rrd is not None:
            new_file(self.rrd, self.force)
        folder = RunFolder(self.out / folder_name(source.name), self.force)
        if not self.json:
            print(f"model  {prepared.chosen}", flush=True)
        work, gallery = folder.work, Gallery() if model.tracks else None
        watchers: list[Watcher] = []
        try:
            if gallery is not None:
                watchers += [MaskStore(), gallery, TimelineFile(work / "timeline.jsonl", source.size)]
            elif isinstance(model, WholeFieldModel) and find_spec("pyarrow") is not None:
                watchers.append(ResponseFile(work / "responses.parquet"))
            if self.pictures:
                rate = source.fps / max(1, round(source.fps / self.pictures))
                if model.tracks:
                    watchers.append(Overlay(work / "overlay.mp4", rate, source.full_size))
                else:
                    watchers.append(EnhancedVideo(work / "enhanced.mp4", rate, source.size))
            recording = None if self.rrd is None else Recording(self.rrd)
            watchers += [] if recording is None else [recording]
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
            if recording is not None:
                recording.finish(in_words(result))
            write_result(result, prepared.about, work, prepared.chosen, gallery)
        except BaseException:
            folder.discard()
            raise
        files = folder.publish()
        if self.json:
            print(json.dumps(summary(result), ensure_ascii=False))
        else:
            print(in_words(result))
            print(f"written  {folder.final}: {', '.join(path.name for path in files)}")
        half = None if self.rrd is None else why_not_whole(self.rrd)
        if half is not None:
            print(f"error: {half}", file=sys.stderr)
        if self.open:
            open_in_browser(folder.final / NAME)
        if result.interrupted:
            return INTERRUPTED
        return 0 if half is None and not result.silent else INCOMPLETE
