"""The controller that plans paths to goals and through unexplored space; `ranging` may stop it."""

from ndtorch.navigation.controllers.goal.control import GoalControl
from ndtorch.navigation.controllers.goal.params import GoalParams
from ndtorch.navigation.controllers.goal.tasks import GoalState

__all__ = ["GoalControl", "GoalParams", "GoalState"]
