"""The first stage, trained and written as a model folder with a card."""

from __future__ import annotations

from pathlib import Path

import tomli_w
import torch
from safetensors.torch import save_file
from torch import Tensor
from tqdm import tqdm

from ndtorch.binding import BindingConfig, FirstStage, spectral_radius, train_first_stage
from ndtorch.errors import InputError


def write_first_stage(gamma: float, radius: float, folder: Path) -> FirstStage:
    """Train the three networks and write `config.toml`, `weights.safetensors` and `README.md`."""
    torch.set_num_threads(1)
    with tqdm(desc="rings", unit=" s", bar_format="{desc}: {n:.1f} simulated s {postfix}") as bar:

        def progress(seconds: float, largest: list[float]) -> None:
            bar.n = seconds
            bar.set_postfix_str("largest weights " + " ".join(f"{w:.3f}" for w in largest))

        stage = train_first_stage(gamma, radius, progress=progress)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        weights = {"motion": stage.motion, "orientation": stage.orientation, "color": stage.color}
        save_file(weights, folder / "weights.safetensors")
        (folder / "config.toml").write_text(config_text(), encoding="utf-8")
        (folder / "README.md").write_text(card(gamma, radius, stage), encoding="utf-8")
    except OSError as error:
        raise InputError(f"{folder} cannot be written: {error.strerror}") from None
    print(f"wrote {folder}")
    return stage


def config_text() -> str:
    """The model's constants as TOML, every key with its meaning."""
    values = BindingConfig().model_dump()
    lines = ["# Constants of the binding model. Seconds where nothing else is said."]
    for name, field in BindingConfig.model_fields.items():
        entry = tomli_w.dumps({name: values[name]}).strip()
        lines.append(f"{entry}  # {field.description}")
    return "\n".join(lines) + "\n"


def card(gamma: float, radius: float, stage: FirstStage) -> str:
    """The model's README: how it was made, and what came out."""
    parts = [
        "# binding",
        "",
        "First-stage networks of the visual binding model, and the constants of both stages. Load it with",
        '`ndtorch.load("binding")`.',
        "",
        "Made by",
        "",
        f"    ndtorch first-stage --gamma {gamma:g} --radius {radius:g}",
        "",
        "on the contracting rings of [B eq. 25-27] (100 x 100 pixels, 100 frames a second, learning from 4 s on, each",
        f"network until its spectral radius reached {radius:g}). There is nothing random in it. Training took",
        f"{stage.seconds:.1f} simulated seconds.",
        "",
    ]
    off = stage.orientation[~torch.eye(3, dtype=torch.bool)]
    claims = {
        "motion": "The paper prints about 0.3 for all weights.",
        "orientation": "The paper prints about 0.45 for all weights. They come out less alike here, "
        f"{float(off.min()):.2f} to {float(off.max()):.2f}:\nthe orientation filters are as large as the stimulus, "
        "and its edges treat 0°, along the pixel grid, differently\nfrom 60° and 120°.",
        "color": "The paper prints about 0.45 for all weights.",
    }
    for name, weights in (("motion", stage.motion), ("orientation", stage.orientation), ("color", stage.color)):
        parts += [f"## {name}", "", claims[name], "", matrix(weights), ""]
        parts += [f"Spectral radius {float(spectral_radius(weights)):.4f}.", ""]
    return "\n".join(parts)


def matrix(weights: Tensor) -> str:
    """Rows of numbers, indented as a code block."""
    return "\n".join("    " + "  ".join(f"{w:.4f}" for w in row) for row in weights.tolist())
