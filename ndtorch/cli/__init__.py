"""The command line: `ndtorch` finds and runs commands; those of binding and `tuning` are the library's own."""

from typing import TYPE_CHECKING

from ndtorch.utils.lazy import lazy

if TYPE_CHECKING:
    from ndtorch.cli.bind import Bind
    from ndtorch.cli.render import Render, Scenes
    from ndtorch.cli.tuning import Tuning

__all__ = ["Bind", "Render", "Scenes", "Tuning"]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy(__name__)
