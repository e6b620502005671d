"""`ndtorch arenas`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Arenas:
    """List the arenas."""

    def run(self) -> int:
        """Print name, size and description of every arena."""
        from ndtorch_robot.sim.arenas import ARENAS

        for name, make in ARENAS.items():
            left, right, bottom, top = make(0).bounds
            print(f"{name:9s} {right - left:4.0f} x {top - bottom:<3.0f} m  {(make.__doc__ or '').splitlines()[0]}")
        print("\nOr a .toml file; its keys are described in robot/ndtorch_robot/sim/arena_file.py.")
        return 0
