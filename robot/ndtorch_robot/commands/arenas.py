"""`ndtorch arenas`."""

from __future__ import annotations

import json
from dataclasses import dataclass


@dataclass(frozen=True)
class Arenas:
    """List the arenas."""

    json: bool = False
    """The arenas are printed as one JSON object, and nothing else is."""

    def run(self) -> int:
        from ndtorch_robot.sim.arenas import ARENAS

        found = {}
        for name, make in ARENAS.items():
            left, right, bottom, top = make(0).bounds
            words = (make.__doc__ or "").splitlines()[0]
            found[name] = {"width_m": right - left, "depth_m": top - bottom, "description": words}
        if self.json:
            print(json.dumps(found))
            return 0
        for name, arena in found.items():
            print(f"{name:10s} {arena['width_m']:4.0f} x {arena['depth_m']:<3.0f} m  {arena['description']}")
        print("\nOr a .toml file; its keys are described in docs/robot/simulation.md.")
        return 0
