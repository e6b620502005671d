"""What can sit at the wheel of a `Navigator`: one file or folder a controller, the contract, and the names."""

from ndtorch.navigation.controllers.contract import (
    ARRIVED,
    CRUISE,
    REVERSE,
    STOPPED,
    SUPPRESSED,
    TURN,
    Command,
    Controller,
    Trace,
)
from ndtorch.navigation.controllers.registry import (
    DEFAULT_CONTROLLER,
    controller_class,
    controller_names,
    make_controller,
    register,
)

__all__ = [
    "ARRIVED",
    "CRUISE",
    "DEFAULT_CONTROLLER",
    "REVERSE",
    "STOPPED",
    "SUPPRESSED",
    "TURN",
    "Command",
    "Controller",
    "Trace",
    "controller_class",
    "controller_names",
    "make_controller",
    "register",
]
