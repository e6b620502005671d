"""
A recording, and its replay
===========================

A drive writes down what the cameras saw and what the navigator wanted. Replayed, the same program must want the same,
bit for bit. A recording of a real car replays the same way. This needs ``ndtorch-robot[sim]``.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

from ndtorch.commands import main
from ndtorch_robot.recording import open_recording

# %%
# Four seconds of driving.
folder = Path(tempfile.mkdtemp())
code = main(
    ["drive", "--seconds", "4", "--out", str(folder / "drive"), "--record", str(folder / "recording"), "--quiet"]
)
assert code == 0
print(sorted(path.name for path in (folder / "recording").iterdir()))

# %%
# Exit code 0 says that all commands are the same, 1 that some differ, 3 that something could not be replayed.
code = main(["replay", str(folder / "recording")])
print("exit code", code)
assert code == 0

# %%
# The steps can be read one by one, the frames with them.
recording = open_recording(folder / "recording")
steps = list(recording.steps())
figure, panels = plt.subplots(2, 1, figsize=(7, 4), sharex=True, layout="constrained")
times = [step.time - steps[0].time for step in steps]
panels[0].plot(times, [step.wanted.speed for step in steps])
panels[0].set_ylabel("speed wanted (m/s)")
panels[1].plot(times, [step.wanted.curvature for step in steps])
panels[1].set_ylabel("curvature wanted (1/m)")
panels[1].set_xlabel("time (s)")
plt.show()
