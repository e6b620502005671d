"""Buildings to drive in, by name."""

from ndtorch_robot.sim.arenas.registry import arena, arenas, load_arena

__all__ = ["arena", "arenas", "load_arena"]
