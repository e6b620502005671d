"""`ndtorch scenes` lists the simulated scenes, `ndtorch render` makes one a video file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Render:
    """Render a simulated scene as a video."""

    scene: Annotated[str, tyro.conf.Positional]
    """Name of the scene, see `ndtorch scenes`."""
    file: Annotated[Path, tyro.conf.Positional]
    """File to write: .mp4, .mkv (lossless) or .avi."""
    seconds: float = 5.0
    """Length of the video, s."""
    fps: float = 100.0
    """Frame rate, Hz."""
    set: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Value of an option of the scene, as wavelength=30; any number of times."""
    force: bool = False
    """Replace the file if it exists."""

    def run(self) -> int:
        from ndtorch.run.folder import new_file
        from ndtorch.run.options import values_of
        from ndtorch.scenes import make_scene
        from ndtorch.scenes.video_writer import VideoWriter
        from ndtorch.utils.files import replacing

        source = make_scene(self.scene, **{"seconds": self.seconds, "fps": self.fps, **values_of(self.set)})
        new_file(self.file, self.force)
        with replacing(self.file) as part, VideoWriter(part, source.fps, source.size) as writer:
            for chunk in source.chunks():
                for frame in chunk:
                    writer.write(frame)
        height, width = source.size
        print(f"{self.file}: {source.length} frames, {width} x {height}, {source.fps:g} a second")
        return 0


@dataclass(frozen=True)
class Scenes:
    """List the simulated scenes."""

    def run(self) -> int:
        from ndtorch.scenes.named import SCENES

        print("\n".join(f"{name:22}{scene.description}" for name, scene in SCENES.items()))
        return 0
