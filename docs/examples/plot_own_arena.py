"""
An arena of your own
====================

An arena is a small TOML file: rooms that touch or overlap, doors, pillars and furniture. The simulated car drives
through it, by sight, and draws a map. This needs ``ndtorch-robot[sim]``.
"""

import tempfile
from pathlib import Path

import matplotlib.image
import matplotlib.pyplot as plt

from ndtorch.commands import main

# %%
arena = """
name = "lab"
rooms = [[0.0, 0.0, 6.0, 2.4], [4.0, 0.0, 6.0, 6.0]]
pillars = [{x = 2.5, y = 1.9, width = 0.2}]
"""
folder = Path(tempfile.mkdtemp())
(folder / "lab.toml").write_text(arena)

# %%
# Fifteen seconds of driving, from the command line or like this.
code = main(["drive", "--arena", str(folder / "lab.toml"), "--seconds", "15", "--out", str(folder / "drive")])
assert code == 0

# %%
# The true path over the plan. Only the picture knows it; the car does not.
figure, axes = plt.subplots(figsize=(8, 6), layout="constrained")
axes.imshow(matplotlib.image.imread(folder / "drive" / "path.png"))
axes.set_axis_off()
plt.show()
