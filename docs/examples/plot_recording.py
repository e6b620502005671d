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
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from ndtorch.cli.commands import main

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
# The messages are those of ROS 2: here ``mcap-ros2-support`` decodes them, which knows nothing of this package. Left:
# the horizon row of the left camera; edges that pass draw slanted lines. Right: the path and the last scan.
topics, rows, path = ["/camera/left/row", "/odom", "/scan"], [], []
with Path(record).open("rb") as file:
    for _, channel, _, told in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(topics):
        if channel.topic == "/odom":
            pose = told.pose.pose
            path.append((pose.position.x, pose.position.y, 2 * np.arctan2(pose.orientation.z, pose.orientation.w)))
        elif channel.topic == "/camera/left/row":
            rows.append(np.frombuffer(bytes(told.data), np.uint16))
        else:
            scan = told
figure, (left, right) = plt.subplots(1, 2, figsize=(11, 5), layout="constrained")
left.imshow(np.stack(rows), "gray", aspect="auto", extent=(0, len(rows[0]), 15, 0))
left.set(xlabel="column (pixels)", ylabel="time (s)", title="/camera/left/row")
x, y, heading = np.array(path).T
right.plot(x, y, label="/odom")
bearing = heading[-1] + scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
right.plot(x[-1] + scan.ranges * np.cos(bearing), y[-1] + scan.ranges * np.sin(bearing), ".", label="/scan")
right.set(
    xlim=(x.min() - 4, x.max() + 4),
    ylim=(y.min() - 4, y.max() + 4),
    xlabel="x (m)",
    title="/odom and /scan",
    aspect="equal",
)
right.legend()
plt.show()
