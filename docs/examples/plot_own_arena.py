"""
An arena of your own
====================

An arena is a small TOML file: rooms that touch or overlap, doors, pillars and furniture. The simulated car drives
through it, by sight, and draws a map. This needs ``ndtorch-robot[sim]``.
"""

import contextlib
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection

from ndtorch.cli.commands import main
from ndtorch_robot.sim.arenas import load_arena

# %%
# Two corridors that meet at a corner, with a pillar. The car starts at the lower left.
arena = """
name = "lab"
rooms = [[0.0, 0.0, 8.0, 2.4], [5.6, 0.0, 8.0, 7.0]]
pillars = [{x = 3.5, y = 1.9, width = 0.2}]
start = [0.8, 1.0, 0.0]
"""
folder = Path(tempfile.mkdtemp())
(folder / "lab.toml").write_text(arena)

# %%
# Twenty-five seconds of driving, from the command line or like this.
with contextlib.chdir(folder):
    code = main(["drive", "--arena", "lab.toml", "--seconds", "25", "--out", "drive"])
assert code == 0

# %%
# The map that the car drew, over the walls of the plan, which the car does not know. A dot is a cell of the map above a
# twentieth of the largest: an edge that was ranged.
drawn = np.load(folder / "drive" / "map.npz")
left, right, bottom, top = drawn["bounds"]
rows, columns = np.nonzero(drawn["cells"] > 0.05 * drawn["cells"].max())
plan = load_arena(str(folder / "lab.toml"))
figure, axes = plt.subplots(figsize=(7, 6), layout="constrained")
axes.add_collection(LineCollection(plan.segments, colors="black", linewidths=1.5, label="walls and pillar"))
axes.plot(left + drawn["cell"] * (columns + 0.5), bottom + drawn["cell"] * (rows + 0.5), "r.", label="map")
axes.set(xlim=(-0.5, 8.5), ylim=(-0.5, 7.5), xlabel="x (m)", ylabel="y (m)", title="map after 25 s", aspect="equal")
axes.legend(loc="upper left")
plt.show()
