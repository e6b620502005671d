"""`ndtorch first-stage`: train the first stage and write it as a model folder with a card."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ndtorch.binding import FirstStage


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

        # The models of the package are kept with the code: they are not replaced by accident.
        new_file(self.out / "config.toml", self.force)
        stage = write_first_stage(self.gamma, self.radius, self.out)
        if self.json:
            print(json.dumps({"folder": str(self.out), "simulated_seconds": stage.seconds}))
        else:
            print(f"wrote {self.out}")
        return 0


def write_first_stage(gamma: float, radius: float, folder: Path) -> FirstStage:
    """Train the three networks and write them as a model."""
    import torch

    from ndtorch.binding import PublishedModel, train_first_stage
    from ndtorch.run.progress import progress_bar

    torch.set_num_threads(1)
    with progress_bar(None, desc="rings", unit=" s", bar_format="{desc}: {n:.1f} simulated s {postfix}") as bar:

        def report(seconds: float, largest: list[float]) -> None:
            bar.n = seconds
            bar.set_postfix_str("largest weights " + " ".join(f"{w:.3f}" for w in largest))

        stage = train_first_stage(gamma, radius, report=report)
    PublishedModel(first_stage=stage).save(folder, overwrite=True)
    return stage
