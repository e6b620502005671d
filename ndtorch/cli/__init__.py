"""The library's commands: `ndtorch bind`, `ndtorch scenes`, `ndtorch render`. Importing them imports no torch."""

from ndtorch.cli.bind import Bind
from ndtorch.cli.render import Render
from ndtorch.cli.scenes import Scenes

__all__ = ["Bind", "Render", "Scenes"]
