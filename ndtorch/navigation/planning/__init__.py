"""Planning in a local map: costmap, Dijkstra, lattice A*, frontiers of exploration, and tracking of a path."""

from ndtorch.navigation.planning.params import PlannerParams

__all__ = ["PlannerParams"]
