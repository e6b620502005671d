"""Drives in the rerun viewer, as they go, from a recording, or into a file. Only this folder knows rerun."""

from ndtorch_robot.view.background import Background
from ndtorch_robot.view.car_view import CarView, Seen, layout
from ndtorch_robot.view.drive_view import DriveView
from ndtorch_robot.view.opening import Where, open_stream
from ndtorch_robot.view.steps import ViewSteps, start_view

__all__ = [
    "Background",
    "CarView",
    "DriveView",
    "Seen",
    "ViewSteps",
    "Where",
    "layout",
    "open_stream",
    "start_view",
]
