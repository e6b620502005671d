"""`ndtorch first-stage`: train the first stage and write it as a model folder with a card."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ndtorch.errors import InputError
from ndtorch.utils.files import write_text

if TYPE_CHECKING:
    from torch import Tensor

    from ndtorch.binding import FirstStage


SHARING = ("scale-free", "retinotopic")
"""Models beside published that have the same first stage, as a copy."""


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
    """Train the three networks and write `config.toml`, `weights.safetensors` and `README.md`."""
    import torch

    from ndtorch.binding import train_first_stage
    from ndtorch.binding.first_stage import write_first_stage as write_weights
    from ndtorch.binding.models.published import PublishedConfig
    from ndtorch.config import config_text
    from ndtorch.run.progress import progress_bar

    torch.set_num_threads(1)
    with progress_bar(None, desc="rings", unit=" s", bar_format="{desc}: {n:.1f} simulated s {postfix}") as bar:

        def report(seconds: float, largest: list[float]) -> None:
            bar.n = seconds
            bar.set_postfix_str("largest weights " + " ".join(f"{w:.3f}" for w in largest))

        stage = train_first_stage(gamma, radius, report=report)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_weights(stage, folder / "weights.safetensors")
        for name in SHARING if folder.name == "published" else ():
            if (folder.parent / name).is_dir():
                write_weights(stage, folder.parent / name / "weights.safetensors")
        write_text(folder / "config.toml", config_text(PublishedConfig()))
        write_text(folder / "README.md", card(gamma, radius, stage))
    except OSError as error:
        raise InputError(f"{folder} cannot be written: {error.strerror}") from None
    return stage


def card(gamma: float, radius: float, stage: FirstStage) -> str:
    """The model's README: how it was made, and what came out."""
    import torch

    from ndtorch.binding import spectral_radius

    parts = [HEAD.format(gamma=gamma, radius=radius, seconds=stage.seconds)]
    off = stage.orientation[~torch.eye(3, dtype=torch.bool)]
    claims = {
        "motion": f"All weights are {float(stage.motion[0, 1]):.4f}; the paper prints about 0.3.",
        "orientation": "The paper prints about 0.45 for all weights. They come out less alike here, "
        f"{float(off.min()):.2f} to {float(off.max()):.2f}:\nthe orientation filters are as large as the stimulus, "
        "and its edges treat 0°, along the pixel grid, differently\nfrom 60° and 120°.",
        "color": f"All weights are {float(stage.color[0, 1]):.4f}; the paper prints about 0.45.",
    }
    for name, weights in (("motion", stage.motion), ("orientation", stage.orientation), ("color", stage.color)):
        parts += [f"## {name}", "", claims[name], ""]
        parts += [matrix(weights), ""] if name == "orientation" else []
        parts += [f"Spectral radius {float(spectral_radius(weights)):.4f}.", ""]
    return "\n".join(parts)


def matrix(weights: Tensor) -> str:
    """Rows of numbers, indented as a code block."""
    return "\n".join("    " + "  ".join(f"{w:.4f}" for w in row) for row in weights.tolist())


HEAD = """# published

The binding model of the dissertation [B, C]: ten sums over the whole field, three fixed networks that refine them, one
that learns, all with feedback delayed by their own step of 10 ms; objects are read from the weights.
`ndtorch.load("published")`; `rule` is competitive, cooperative or hebbian.

**For** the published stimuli, and for comparison. **Not for** video of a camera (load `foreground`) nor scenes of
unknown objects (load `scale-free`, or `retinotopic`, which also says where they are).

## How it was made

    ndtorch first-stage --gamma {gamma:g} --radius {radius:g}

on the contracting rings of [B eq. 25-27] (100 x 100 pixels, 100 frames a second, learning from 4 s on, each network
until its spectral radius reached {radius:g}), {seconds:.1f} simulated seconds, nothing random. The second stage learns
as it looks. All other constants are printed in the papers, or
[chosen where they are silent](../../docs/binding.md#choices-that-the-papers-leave-open).

## How it was measured, and where it fails

[Claims of the papers](../README.md) and [random scenes](../../docs/accuracy.md#random-scenes). Bars alike in everything
are one object. At high learning rates the outputs alternate from step to step; the verdict says so. On a road camera it
says `learning`, and claims nothing.

## Export

The whole forward, for fixed chunk lengths, also to ONNX ([models](../../docs/models.md#export)).

## Weights
"""
