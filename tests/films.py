"""The ten sums of rendered scenes, filmed once for all tests and all processes of a run: a scene takes 17 seconds."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ndtorch.scenes import FrameSource
from ndtorch_train.superposed import LoneBar, Stimuli, film_bars, rendered_sums


class Films:
    """Films in a folder that all processes of a run share.

    Args:
        folder: where they are kept.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __call__(self, scene: Callable[..., FrameSource], **options: Any) -> Tensor:
        """The ten sums of every frame of a scene, `[T, 10]`.

        Args:
            scene: makes it, such as `ndtorch.scenes.two_bars`.
            options: of the scene.
        """
        name = f"{scene.__name__} {sorted(options.items())}"
        sums: Tensor = self.keep(name, lambda: rendered_sums(scene(**options)))
        return sums

    def bars(self) -> Stimuli:
        """Films of the red, the green and the blue bar alone."""
        red, green, blue = self.keep("lone bars", lambda: tuple(map(tuple, film_bars().bars)))
        return Stimuli((LoneBar(*red), LoneBar(*green), LoneBar(*blue)))

    def keep(self, name: str, make: Callable[[], Any]) -> Any:
        """What `make` gives, made once."""
        path = self.folder / f"film-{sha256(name.encode()).hexdigest()[:16]}.pt"
        with path.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not path.exists():
                part = path.with_suffix(".part")
                torch.save(make(), part)
                part.replace(path)
        return torch.load(path)


def shared_folder(base: Path) -> Path:
    """The folder that all processes of a run share, from a process's own."""
    return base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
