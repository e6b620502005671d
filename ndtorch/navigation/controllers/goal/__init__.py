"""The controller that is told where to go: it plans on what it has seen, and `ranging` keeps the last word."""

from ndtorch.navigation.controllers.goal.control import GoalControl
from ndtorch.navigation.controllers.goal.params import GoalParams
from ndtorch.navigation.controllers.goal.state import GoalState

__all__ = ["GoalControl", "GoalParams", "GoalState"]
