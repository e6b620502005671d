"""Drive links by name: `[link] kind = "serial"` in a car's file chooses one; see docs/robot/protocol.md.

A link is a class that is a `ports.Drive`, a table of settings, and a function with `@link(name, settings)` that opens
it: a file in this folder, or anywhere else.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from ndtorch.errors import InputError
from ndtorch.utils.toml import Strict
from ndtorch_robot.kinds import Kind, Kinds
from ndtorch_robot.ports import CameraPair, Clock, Drive, Report

if TYPE_CHECKING:
    from ndtorch_robot.sim.simulation import Simulation

SERIAL, HOSTED_BOARD, SIMULATED_WORLD = "serial", "hosted-board", "simulated-world"


@runtime_checkable
class MovesWorld(Protocol):
    """A link that moves a simulated car: it also knows how that world is seen."""

    def cameras_and_clock(self) -> tuple[CameraPair, Clock]:
        """The cameras in that world, and the clock of a loop in it."""
        ...


@dataclass(frozen=True)
class Opening:
    """What a link is opened with.

    Attributes:
        board_name: name that the board must have.
        report: called for every event.
        simulation: the world in which the car is to move, where it is a simulated one.
    """

    board_name: str
    report: Report
    simulation: Simulation | None = None


LINKS = Kinds("link", __name__)
link = LINKS.register


def check_link(values: Mapping[str, Any]) -> tuple[Kind, Strict]:
    """A `[link]` table: its kind and its settings; `InputError` for an unknown kind, key or value."""
    rest = dict(values)
    return LINKS.checked(str(rest.pop("kind", SERIAL)), rest, "link")


def open_link(values: Mapping[str, Any], opening: Opening) -> Drive:
    """Open the link of a `[link]` table.

    Raises:
        InputError: as `check_link`; a link that cannot be opened; one that moves no simulated car where it must.
    """
    kind, settings = check_link(values)
    drive: Drive = kind.open(settings, opening)
    if opening.simulation is not None and not isinstance(drive, MovesWorld):
        drive.close()
        moving = f"link.kind = {HOSTED_BOARD!r} or {SIMULATED_WORLD!r}"
        raise InputError(f"a simulated world is driven by {moving}, got {values.get('kind', SERIAL)!r}")
    return drive
