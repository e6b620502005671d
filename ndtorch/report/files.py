"""Files that a run of `ndtorch bind` writes: all of them or none."""

from __future__ import annotations

import json
import re
import shutil
import tempfile
from pathlib import Path

import torch
from torch import Tensor

from ndtorch.binding import BindingSignals, save_state
from ndtorch.errors import InputError
from ndtorch.report.figures import draw_all
from ndtorch.report.recording import Recording
from ndtorch.report.words import summary
from ndtorch.run.options import Prepared
from ndtorch.run.pictures import Picture, Watcher
from ndtorch.run.result import BindResult
from ndtorch.scenes.video_writer import VideoWriter
from ndtorch.vision import FEATURES


class OutputFolder:
    """A result folder that appears complete or not at all: files are written beside it and moved in at the end."""

    def __init__(self, parent: Path, name: str) -> None:
        self.final = parent / name
        try:
            self.final.mkdir(parents=True, exist_ok=True)
            self.work = Path(tempfile.mkdtemp(prefix=f".{name}-", dir=parent))
        except OSError as error:
            raise InputError(f"--out {parent} cannot be written: {error.strerror}") from None

    def publish(self) -> list[Path]:
        """Move everything in; returns the files."""
        moved = [path.replace(self.final / path.name) for path in sorted(self.work.iterdir())]
        self.work.rmdir()
        return moved

    def discard(self) -> None:
        """Drop what was written, and the folder if nothing was in it."""
        shutil.rmtree(self.work, ignore_errors=True)
        if not any(self.final.iterdir()):
            self.final.rmdir()


def folder_name(name: str) -> str:
    """The name of a source as a folder name: the stem of a path, with nothing but letters, digits, `.`, `_`, `-`."""
    stem = Path(name).stem if "/" in name else name
    return re.sub(r"[^A-Za-z0-9._-]+", "-", stem).strip("-.") or "run"


def write_result(result: BindResult, prepared: Prepared, folder: Path) -> None:
    """Write objects.json, state.safetensors and the four figures."""
    text = json.dumps(summary(result), indent=2, ensure_ascii=False)
    (folder / "objects.json").write_text(text + "\n", encoding="utf-8")
    about = {**prepared.about, "frames": prepared.about["frames"] + result.frames}
    save_state(result.state, folder / "state.safetensors", {"run": json.dumps(about)})
    draw_all(result, folder)


class EnhancedVideo(Watcher):
    """Writes the input beside its enhanced image."""

    def __init__(self, path: Path, fps: float, size: tuple[int, int]) -> None:
        self.size = (size[0] // 2 * 2, size[1] // 2 * 2)
        self.writer = VideoWriter(path, fps, (self.size[0], 2 * self.size[1]))

    def picture(self, picture: Picture) -> None:
        height, width = self.size
        sides = [torch.from_numpy(image)[:height, :width] for image in (picture.frame, picture.enhanced)]
        self.writer.write(torch.cat(sides, 1).permute(2, 0, 1))

    def close(self) -> None:
        """Finish the file."""
        self.writer.close()

    def signals(self, signals: BindingSignals, weights: Tensor) -> None:
        """Nothing to show."""


class RunRecording(Watcher):
    """Shows a run to a rerun recording."""

    def __init__(self, path: Path) -> None:
        self.recording = Recording(path)

    def picture(self, picture: Picture) -> None:
        name = FEATURES[picture.winner] if picture.winner >= 0 else None
        self.recording.frame(picture.time, picture.frame, picture.enhanced, name)

    def signals(self, signals: BindingSignals, weights: Tensor) -> None:
        times = signals.time.tolist()
        for at, outputs in zip(times, signals.outputs, strict=True):
            self.recording.outputs(at, outputs)
        if times:
            self.recording.weights(times[-1], weights)

    def finish(self, text: str) -> None:
        """Add the table of objects and close the file."""
        self.recording.objects(text)
        self.recording.close()
