"""`ndtorch render`: a scene as a video file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


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

    def run(self) -> int:
        """Do it; returns the exit code."""
        from ndtorch.scenes import make_scene
        from ndtorch.scenes.video_writer import VideoWriter

        given = {"seconds": self.seconds, "fps": self.fps, "phase": self.phase, "seed": self.seed}
        source = make_scene(self.scene, **{name: value for name, value in given.items() if value is not None})
        done = False
        try:
            with VideoWriter(self.file, source.fps, source.size) as writer:
                for chunk in source.chunks():
                    for frame in chunk:
                        writer.write(frame)
            done = True
        finally:
            if not done:
                self.file.unlink(missing_ok=True)
        print(f"{self.file}: {source.length} frames, {source.size[1]} x {source.size[0]}, {source.fps:g} a second")
        return 0
