"""`ndtorch scenes`: what there is to look at."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Scenes:
    """List the simulated scenes."""

    def run(self) -> int:
        """Do it; returns the exit code."""
        from ndtorch.scenes.named import SCENES

        for name, scene in SCENES.items():
            print(f"{name:22}{scene.description}")
        return 0
