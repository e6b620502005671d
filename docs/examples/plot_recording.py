"""
A recording, and its replay
===========================

A drive records what the cameras saw and what the navigator wanted. Replayed, the same program must want the same,
bit for bit. A recording of a real car replays the same way; Foxglove and ROS 2 open it, too. This needs
``ndtorch-robot[sim]``.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from ndtorch.cli.commands import main
from ndtorch_robot.recording import open_recording

# %%
# Fifteen seconds of driving in a room.
folder = Path(tempfile.mkdtemp())
out, record = str(folder / "drive"), str(folder / "recording.mcap")
code = main(["drive", "--arena", "room", "--seconds", "15", "--out", out, "--record", record, "--quiet"])
assert code == 0
print(f"{Path(record).stat().st_size / 1e6:.1f} MB")

# %%
# Exit code 0 says that all commands are the same, 1 that some differ, 3 that something could not be replayed.
code = main(["replay", record])
print("exit code", code)
assert code == 0

# %%
# The steps can be read one by one, the frames with them. Above: the horizon row of the left camera over time; edges
# that pass draw slanted lines. Below: what the navigator wanted.
recording = open_recording(Path(record))
steps = list(recording.steps())
times = [step.time - steps[0].time for step in steps]
rows = np.stack([np.asarray(step.frames.left.row).reshape(3, -1).T for step in steps])
figure, panels = plt.subplots(
    3, 1, figsize=(8, 7), sharex=True, layout="constrained", gridspec_kw={"height_ratios": [3, 1, 1]}
)
panels[0].imshow(rows.transpose(1, 0, 2), aspect="auto", extent=(times[0], times[-1], rows.shape[1], 0))
panels[0].set(ylabel="column (pixels)", title="horizon row of the left camera")
panels[1].plot(times, [step.wanted.speed for step in steps])
panels[1].set_ylabel("speed (m/s)")
panels[2].plot(times, [step.wanted.curvature for step in steps])
panels[2].set(ylabel="curvature (1/m)", xlabel="time (s)")
plt.show()
