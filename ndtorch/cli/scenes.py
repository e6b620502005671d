"""`ndtorch scenes`: what there is to look at."""

from __future__ import annotations

import json
from dataclasses import dataclass


@dataclass(frozen=True)
class Scenes:
    """List the simulated scenes."""

    json: bool = False
    """Print them as one JSON object and nothing else."""

    def run(self) -> int:
        """Do it; returns the exit code."""
        from ndtorch.scenes.named import SCENES

        if self.json:
            print(json.dumps({name: scene.description for name, scene in SCENES.items()}))
            return 0
        for name, scene in SCENES.items():
            print(f"{name:22}{scene.description}")
        return 0
