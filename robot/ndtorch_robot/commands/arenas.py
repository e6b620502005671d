"""`ndtorch arenas`."""

from __future__ import annotations

import json
from dataclasses import dataclass


@dataclass(frozen=True)
class Arenas:
    """List the arenas."""

    json: bool = False
    """Print the arenas as one JSON object, and nothing else."""

    def run(self) -> int:
        from ndtorch_robot.sim.arenas import ARENAS, describe_arena, load_arena

        listed = {}
        for name in ARENAS:
            left, right, bottom, top = load_arena(name).bounds
            words = describe_arena(name)
            listed[name] = {"width_m": right - left, "depth_m": top - bottom, "description": words}
            if not self.json:
                print(f"{name:10s} {right - left:4.0f} x {top - bottom:<3.0f} m  {words}")
        print(json.dumps(listed) if self.json else "\nOr a .toml file; see docs/robot/simulation.md.")
        return 0
