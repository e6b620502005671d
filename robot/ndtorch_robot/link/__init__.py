"""Drive links by name: `[link] kind = "serial"` in a car's file chooses one; see docs/robot/protocol.md.

A link is a class that is a `ports.Drive`, a table of settings, and a function of settings and opening with
`@link(name)`: a file in this folder, or anywhere else.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ndtorch.errors import InputError
from ndtorch.utils.registry import Registry
from ndtorch.utils.toml import Strict, check
from ndtorch_robot.ports import Drive, Report

if TYPE_CHECKING:
    from ndtorch_robot.sim.simulation import Simulation

SERIAL, SIMULATED_BOARD, HOSTED_BOARD, SIMULATED_WORLD = "serial", "simulated-board", "hosted-board", "simulated-world"


@dataclass(frozen=True)
class Opening:
    """What a link is opened with."""

    board_name: str  # that the board must have
    report: Report
    simulation: Simulation | None = None  # the world in which the car is to move, where it is a simulated one

    @property
    def world(self) -> Simulation:
        if self.simulation is None:
            raise InputError("a link to a simulated car needs the table [simulation]")
        return self.simulation


LINKS: Registry[Callable[..., Drive]] = Registry("link.kind", __name__)
link = LINKS.register


def check_link(values: Mapping[str, Any]) -> tuple[Callable[..., Drive], Strict]:
    """What opens the link of a `[link]` table, and its settings; `InputError` for an unknown kind, key or value."""
    opener = LINKS.find(str(values.get("kind", SERIAL)))
    kind: type[Strict] = inspect.get_annotations(opener, eval_str=True)["settings"]
    return opener, check({key: value for key, value in values.items() if key != "kind"}, kind, "link")


def open_link(values: Mapping[str, Any], opening: Opening) -> Drive:
    """Open the link of a `[link]` table.

    Raises:
        InputError: as `check_link`; a link that cannot be opened; one that moves no simulated car where it must.
    """
    opener, settings = check_link(values)
    drive = opener(settings, opening)
    if opening.simulation is not None and drive.cameras_and_clock() is None:
        drive.close()
        moving = f"link.kind = {SIMULATED_BOARD!r}, {HOSTED_BOARD!r} or {SIMULATED_WORLD!r}"
        raise InputError(f"a simulated world is driven by {moving}, got {values.get('kind', SERIAL)!r}")
    return drive
