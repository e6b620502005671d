"""A car in the rerun viewer, as it drives, from a recording, or into a file. Only this folder knows rerun."""

from ndtorch_robot.view.car_view import CarView, Seen, layout, plan_bounds
from ndtorch_robot.view.observer import Background, ViewSteps, start_view
from ndtorch_robot.view.stream import Where, open_stream

__all__ = [
    "Background",
    "CarView",
    "Seen",
    "ViewSteps",
    "Where",
    "layout",
    "open_stream",
    "plan_bounds",
    "start_view",
]
