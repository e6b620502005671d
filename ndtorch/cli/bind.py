"""`ndtorch bind`: the objects in a scene or a video."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ndtorch.commands import INTERRUPTED
from ndtorch.memory import tune_allocator
from ndtorch.run.options import BindJob, prepare, prepare_video, uses_front_end


@dataclass(frozen=True)
class Bind(BindJob):
    """Find the objects in a scene or a video: their number and their features.

    Prints the table of objects and a verdict, and writes pictures, the learned state and an enhanced video
    into a folder of its own. Of ordinary video, prints and writes the objects over time: a timeline and an overlay.
    """

    source: Annotated[str, tyro.conf.Positional] = "two-bars"
    """Scene name (see `ndtorch scenes`), video file, folder of images, camera (`camera:0`, /dev/video0) or address."""
    out: Path = Path("out")
    """Folder to write to; the run gets a folder named after its source in it."""
    json: bool = False
    """Print one JSON object on stdout and nothing else."""
    rrd: Path | None = None
    """Also write a recording for the rerun viewer."""

    def run(self) -> int:
        """Do it; returns the exit code."""
        import torch

        # Programs choose; the library never does. Two threads get in each other's way on a busy machine.
        torch.set_num_threads(1)
        tune_allocator()
        return self.run_timeline() if uses_front_end(self) else self.run_table()

    def run_timeline(self) -> int:
        """Ordinary video: objects over time."""
        from tqdm import tqdm

        from ndtorch.report.files import OutputFolder, folder_name
        from ndtorch.report.timeline import Overlay, draw_timeline, in_words, summary, write_timeline
        from ndtorch.run.video import run_video

        source = prepare_video(self)
        folder = OutputFolder(self.out, folder_name(source.name))
        try:
            overlay, rate = None, 0.0
            if self.pictures > 0:
                # Every n-th frame, played at the speed it was taken.
                rate = source.fps / max(1, round(source.fps / self.pictures))
                overlay = Overlay(folder.work / "overlay.mp4", rate, source.size)
            with tqdm(total=source.length, unit=" frames", disable=self.json, leave=False, mininterval=0.5) as bar:

                def progress(frames: int) -> None:
                    bar.update(frames)

                result = run_video(source, self.without, rate, () if overlay is None else (overlay,), progress)
            if overlay is not None:
                overlay.close()
            text = json.dumps(summary(result), ensure_ascii=False)
            (folder.work / "objects.json").write_text(text + "\n", encoding="utf-8")
            write_timeline(result, folder.work / "timeline.jsonl")
            draw_timeline(result, folder.work / "timeline.png")
        except BaseException:
            folder.discard()
            raise
        files = folder.publish()
        if self.json:
            print(text)
        else:
            print(in_words(result))
            print(f"written  {folder.final}: {', '.join(path.name for path in files)}")
        return INTERRUPTED if result.interrupted else 0

    def run_table(self) -> int:
        """The published model: one table of objects."""
        from tqdm import tqdm

        from ndtorch.report.files import EnhancedVideo, OutputFolder, RunRecording, folder_name, write_result
        from ndtorch.report.words import in_words, summary
        from ndtorch.run.pictures import Watcher
        from ndtorch.run.run import run_binding

        prepared = prepare(self)
        source = prepared.source
        folder = OutputFolder(self.out, folder_name(source.name))
        try:
            watchers: list[Watcher] = []
            video = recording = None
            if self.pictures > 0:
                video = EnhancedVideo(folder.work / "enhanced.mp4", min(self.pictures, source.fps), source.size)
                watchers.append(video)
            if self.rrd is not None:
                recording = RunRecording(self.rrd)
                watchers.append(recording)
            total = None if source.length is None else source.length - prepared.start
            with tqdm(total=total, unit=" frames", disable=self.json, leave=False, mininterval=0.5) as bar:

                def progress(frames: int) -> None:
                    bar.update(frames)

                result = run_binding(
                    prepared.model,
                    source,
                    prepared.state,
                    prepared.start,
                    self.pictures,
                    tuple(watchers),
                    progress,
                    self.device,
                )
            if video is not None:
                video.close()
            if recording is not None:
                recording.finish(in_words(result))
            write_result(result, prepared, folder.work)
        except BaseException:
            folder.discard()
            raise
        files = folder.publish()
        if self.json:
            print(json.dumps(summary(result), ensure_ascii=False))
        else:
            print(in_words(result))
            print(f"written  {folder.final}: {', '.join(path.name for path in files)}")
        return INTERRUPTED if result.interrupted else 0
