"""The command line: `ndtorch` finds and runs commands, `bind`, `scenes` and `render` are the library's own."""

from typing import TYPE_CHECKING

from ndtorch.utils.lazy import lazy

if TYPE_CHECKING:
    from ndtorch.cli.bind import Bind
    from ndtorch.cli.render import Render, Scenes

__all__ = ["Bind", "Render", "Scenes"]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy(__name__)
