"""Drives in the rerun viewer, as they go, from a recording, or into a file. Only this folder knows rerun."""

from robot.view.background import Background
from robot.view.car_view import CarView, Seen, layout
from robot.view.drive_view import DriveView
from robot.view.opening import Where, open_stream
from robot.view.steps import ViewRecorded, ViewSteps, start_view

__all__ = [
    "Background",
    "CarView",
    "DriveView",
    "Seen",
    "ViewRecorded",
    "ViewSteps",
    "Where",
    "layout",
    "open_stream",
    "start_view",
]
