"""`ndtorch bind`: the objects in a scene or a video."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ndtorch.cli.command_run import INCOMPLETE, INTERRUPTED
from ndtorch.errors import InputError
from ndtorch.run.arguments import choices
from ndtorch.run.options import BindJob

if TYPE_CHECKING:
    from ndtorch.report.films import EnhancedVideo, Overlay
    from ndtorch.report.responses import ResponseFile
    from ndtorch.run.opening import Prepared


@choices(
    model=("foreground", "published", "retinotopic", "scale-free", "FOLDER"),
    rule=("competitive", "cooperative", "hebbian"),
    order=("filter-first", "printed"),
    fit=("crop", "stretch"),
)
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
    """Folder to write to; the run gets a new folder in it, named after its source: two-bars, then two-bars-2."""
    force: bool = False
    """Write into the folder named after the source even if results are there; files of the same names are replaced."""
    json: bool = False
    """Print one JSON object on stdout and nothing else."""
    open: bool = False
    """Show report.html in the browser when the run has ended."""
    rrd: Path | None = None
    """Also write a recording for the rerun viewer."""
    mask: bool = False
    """Also write mask.mp4 of the model foreground: white where an object is, a frame for every frame of the source."""

    def run(self) -> int:
        """Do it; returns the exit code."""
        import torch

        from ndtorch.report.advice import CameraMotion, advice
        from ndtorch.report.films import RunRecording
        from ndtorch.report.gallery import Gallery
        from ndtorch.report.mask_store import MaskStore
        from ndtorch.report.page import NAME, folder_name, open_in_browser, write_result
        from ndtorch.report.recording import why_not_whole
        from ndtorch.report.timeline import TimelineFile
        from ndtorch.report.words import in_words, summary
        from ndtorch.run.folder import RunFolder, new_file
        from ndtorch.run.opening import prepare
        from ndtorch.run.progress import progress_bar, tell_if_long
        from ndtorch.run.run import run_model
        from ndtorch.run.watchers import Watcher
        from ndtorch.utils.tensors import tune_allocator

        # Programs choose; the library never does. Two threads get in each other's way on a busy machine.
        torch.set_num_threads(1)
        tune_allocator()
        prepared = prepare(self)
        if self.mask and prepared.model.name != "foreground":
            raise InputError(f"--mask is an option of foreground; the model is {prepared.model.name}")
        source = prepared.source
        if self.rrd is not None:
            new_file(self.rrd, self.force)
        folder = RunFolder(self.out / folder_name(source.name), self.force)
        if not self.json:
            print(f"model  {prepared.chosen}", flush=True)
        tracks = prepared.model.tracks
        masks, gallery, camera = (MaskStore(), Gallery(), CameraMotion()) if tracks else (None, None, None)
        try:
            film = self.film(prepared, folder.work)
            recording = None if self.rrd is None else RunRecording(self.rrd)
            timeline = TimelineFile(folder.work / "timeline.jsonl", source.size) if tracks else None
            responses = self.responses(prepared, folder.work)
            watching = (film, recording, masks, timeline, gallery, camera, responses)
            watchers: list[Watcher] = [one for one in watching if one is not None]
            total = None if source.length is None else source.length - prepared.start
            tell_if_long(total)
            with progress_bar(total, self.json, unit=" frames", leave=False, mininterval=0.5) as bar:
                told = False

                def report(frames: int) -> None:
                    nonlocal told
                    bar.update(frames)
                    line = None if camera is None or told else camera.advice()
                    if line is not None:
                        told = True
                        bar.write(f"note: {line}", file=sys.stderr)

                result = run_model(
                    prepared.model,
                    source,
                    prepared.state,
                    prepared.start,
                    self.pictures,
                    watchers,
                    report,
                    self.device,
                )
            if masks is not None and camera is not None:
                result.advice = advice(result, camera, masks)
            if film is not None:
                film.close()
            if recording is not None:
                recording.finish(in_words(result))
            trouble = write_result(result, prepared.about, folder.work, prepared.chosen, self.mask, gallery)
            trouble = trouble or (None if timeline is None else timeline.trouble)
            if responses is not None:
                responses.close()
                trouble = trouble or responses.trouble
        except BaseException:
            folder.discard()
            raise
        finally:
            if masks is not None:
                masks.close()
        files = folder.publish(whole=not result.interrupted)
        if self.json:
            print(json.dumps(summary(result), ensure_ascii=False))
        else:
            print(in_words(result))
            print(f"written  {folder.final}: {', '.join(path.name for path in files)}")
        half = None if self.rrd is None else why_not_whole(self.rrd)
        if half is not None:
            print(f"error: {half}", file=sys.stderr)
        if trouble is not None:
            print(f"error: figures cannot be written: {trouble.strerror or trouble}", file=sys.stderr)
        elif self.open:
            open_in_browser(folder.final / NAME)
        if result.interrupted:
            return INTERRUPTED
        return 0 if trouble is None and half is None and not result.silent else INCOMPLETE

    @staticmethod
    def responses(prepared: Prepared, folder: Path) -> ResponseFile | None:
        """responses.parquet, of models over the whole field and where pyarrow is installed."""
        from ndtorch.binding.models.whole_field import WholeFieldModel
        from ndtorch.report.responses import ResponseFile

        if find_spec("pyarrow") is None or not isinstance(prepared.model, WholeFieldModel):
            return None
        return ResponseFile(folder / "responses.parquet", prepared.model)

    def film(self, prepared: Prepared, folder: Path) -> EnhancedVideo | Overlay | None:
        """What is written of the pictures: every n-th frame, played at the speed at which it was taken."""
        from ndtorch.report.films import EnhancedVideo, Overlay

        if self.pictures == 0:
            return None
        source = prepared.source
        rate = source.fps / max(1, round(source.fps / self.pictures))
        if prepared.model.tracks:
            return Overlay(folder / "overlay.mp4", rate, source.full_size)
        return EnhancedVideo(folder / "enhanced.mp4", rate, source.size)
