"""Command line: `ndtorch bind`, `ndtorch scenes`, `ndtorch render`."""

from __future__ import annotations

import json
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ndtorch.errors import InputError
from ndtorch.memory import tune_allocator
from ndtorch.report.job import BindJob, prepare

INTERRUPTED = 130


@dataclass(frozen=True)
class Bind(BindJob):
    """Find the objects in a scene or a video: their number and their features.

    Prints the table of objects and a verdict, and writes pictures, the learned state and an enhanced video
    into a folder of its own.
    """

    source: Annotated[str, tyro.conf.Positional] = "two-bars"
    """Scene name (see `ndtorch scenes`), video file, folder of images, camera (`camera:0`, /dev/video0) or address."""
    out: Path = Path("out")
    """Folder to write to; the run gets a folder named after its source in it."""
    json: bool = False
    """Print one JSON object on stdout and nothing else."""
    rrd: Path | None = None
    """Also write a recording for the rerun viewer."""


@dataclass(frozen=True)
class Scenes:
    """List the simulated scenes."""


@dataclass(frozen=True)
class Render:
    """Render a simulated scene as a video."""

    scene: Annotated[str, tyro.conf.Positional]
    """Name of the scene."""
    file: Annotated[Path, tyro.conf.Positional]
    """File to write: .mp4, .mkv (lossless) or .avi."""
    seconds: float = 5.0
    """Length of the video."""
    phase: float | None = None
    """Lead of the green bar's brightness over the red bar's, degrees."""
    seed: int | None = None
    """Pattern of the random shadow."""
    fps: float = 100.0
    """Frames per second."""


Command = (
    Annotated[Bind, tyro.conf.subcommand("bind")]
    | Annotated[Scenes, tyro.conf.subcommand("scenes")]
    | Annotated[Render, tyro.conf.subcommand("render")]
)


def main(arguments: list[str] | None = None) -> int:
    """Entry point of the `ndtorch` command; returns the exit code: 0, 2 for unusable input, 130 for Ctrl-C."""
    command = tyro.cli(
        Command,
        prog="ndtorch",
        description="Insect-inspired vision: find the objects in a scene.",
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff, tyro.conf.DisallowNone),
    )
    try:
        with warnings.catch_warnings():
            # Remarks such as "is grey" are for the user of this command: one line, and no source code.
            warnings.simplefilter("always", UserWarning)
            warnings.showwarning = note
            return run(command)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped before there was anything to keep", file=sys.stderr)
        return INTERRUPTED


def run(command: Bind | Scenes | Render) -> int:
    """Run one of the commands."""
    if isinstance(command, Bind):
        return bind(command)
    if isinstance(command, Render):
        return render(command)
    return scenes()


def note(message: Warning | str, *_: object, **__: object) -> None:
    """Show a warning as one line."""
    print(f"note: {message}", file=sys.stderr)


def bind(command: Bind) -> int:
    """Run `ndtorch bind`."""
    import torch
    from tqdm import tqdm

    from ndtorch.report.files import EnhancedVideo, OutputFolder, RunRecording, folder_name, write_result
    from ndtorch.report.pictures import Watcher
    from ndtorch.report.run import run_binding
    from ndtorch.report.words import in_words, summary

    # Programs choose; the library never does. Two threads get in each other's way on a busy machine.
    torch.set_num_threads(1)
    tune_allocator()
    prepared = prepare(command)
    source = prepared.source
    folder = OutputFolder(command.out, folder_name(source.name))
    try:
        watchers: list[Watcher] = []
        video = recording = None
        if command.pictures > 0:
            video = EnhancedVideo(folder.work / "enhanced.mp4", min(command.pictures, source.fps), source.size)
            watchers.append(video)
        if command.rrd is not None:
            recording = RunRecording(command.rrd)
            watchers.append(recording)
        total = None if source.length is None else source.length - prepared.start
        with tqdm(total=total, unit=" frames", disable=command.json, leave=False, mininterval=0.5) as bar:

            def progress(frames: int) -> None:
                bar.update(frames)

            result = run_binding(
                prepared.model,
                source,
                prepared.state,
                prepared.start,
                command.pictures,
                tuple(watchers),
                progress,
                command.device,
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
    if command.json:
        print(json.dumps(summary(result), ensure_ascii=False))
    else:
        print(in_words(result))
        print(f"written  {folder.final}: {', '.join(path.name for path in files)}")
    return INTERRUPTED if result.interrupted else 0


def scenes() -> int:
    """Run `ndtorch scenes`."""
    from ndtorch.scenes import SCENES

    for name, scene in SCENES.items():
        print(f"{name:22}{scene.description}")
    return 0


def render(command: Render) -> int:
    """Run `ndtorch render`."""
    from ndtorch.scenes import make_scene
    from ndtorch.scenes.video_writer import VideoWriter

    given = {"seconds": command.seconds, "fps": command.fps, "phase": command.phase, "seed": command.seed}
    source = make_scene(command.scene, **{name: value for name, value in given.items() if value is not None})
    done = False
    try:
        with VideoWriter(command.file, source.fps, source.size) as writer:
            for chunk in source.chunks():
                for frame in chunk:
                    writer.write(frame)
        done = True
    finally:
        if not done:
            command.file.unlink(missing_ok=True)
    print(f"{command.file}: {source.length} frames, {source.size[1]} x {source.size[0]}, {source.fps:g} a second")
    return 0


if __name__ == "__main__":
    sys.exit(main())
