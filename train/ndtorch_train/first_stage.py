"""`ndtorch first-stage`: train the first stage and write it as a model folder with a card."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class FirstStageOptions:
    """Train the three first-stage networks on the ring stimulus and write a model folder."""

    gamma: float = 5.0
    """Learning rate, 1/s: 5 in paper B, 50 in paper C."""
    radius: float = 0.9
    """Spectral radius at which each network stops."""
    out: Path = Path("out/first-stage")
    """Model folder to write."""
    force: bool = False
    """Replace the model that is in that folder."""
    json: bool = False
    """Print one JSON object and nothing else."""

    def run(self) -> int:
        """Train and write; returns the exit code."""
        from ndtorch.run.folder import new_file
        from ndtorch_train.first_stage_folder import write_first_stage

        # The models of the package are kept with the code: they are not replaced by accident.
        new_file(self.out / "config.toml", self.force)
        stage = write_first_stage(self.gamma, self.radius, self.out)
        if self.json:
            print(json.dumps({"folder": str(self.out), "simulated_seconds": stage.seconds}))
        else:
            print(f"wrote {self.out}")
        return 0
