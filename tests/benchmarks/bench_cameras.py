"""Cameras, correction and recording: from the frame to the command, and what recording costs the loop.

`python -m tests.benchmarks.bench_cameras`
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
import torch

from ndtorch.navigation import Strips
from ndtorch.navigation.options import NavigatorOptions
from ndtorch.navigation.stereo.calibration_files import StereoCalibration, stereo_calibration
from ndtorch.navigation.stereo.strips import cut_strips
from ndtorch_robot.calibration import Rectifier
from ndtorch_robot.cameras import CameraSettings, FramesEnded, StereoCameras
from ndtorch_robot.cameras.pair import to_tensor
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import DriveCommand, Step, StereoFrames
from ndtorch_robot.recording import Recorder
from ndtorch_robot.sim.simulation import RIG
from tests.benchmarks.bench_navigation import stereo_pair
from tests.benchmarks.timing import Row, in_turn, table

TITLE = "Cameras and recording (two 640x480 films)"
STILL = DriveCommand(0.5, 0.0)


class Unqueued(Recorder):
    """A recorder that writes a step at once, with a chunk of its own."""

    def step(self, step: Step) -> None:
        self.write(self.waiting_of(step))
        self.flush()


def calibration() -> StereoCalibration:
    """Two cameras that are a little askew."""
    matrix = np.array([[428.0, 0.0, 322.0], [0.0, 429.0, 237.0], [0.0, 0.0, 1.0]])
    turn, distortion = cv2.Rodrigues(np.full(3, 0.01))[0], np.array([-0.12, 0.05, 0.0, 0.0, 0.0])
    return stereo_calibration([matrix] * 2, [distortion] * 2, turn, np.array([-0.3, 0.0, 0.0]), (640, 480))


def films(folder: Path, count: int) -> tuple[str, str]:
    """Two MJPG films of a scene that slides by."""
    names = (str(folder / "left.avi"), str(folder / "right.avi"))
    writers = [cv2.VideoWriter(name, cv2.VideoWriter.fourcc(*"MJPG"), 30, (640, 480)) for name in names]
    for n in range(count):
        for writer, frame in zip(writers, stereo_pair(n % 30), strict=True):
            writer.write(np.ascontiguousarray(frame[..., ::-1]))
    for writer in writers:
        writer.release()
    return names


def frame_to_command(names: tuple[str, str], rectifier: Rectifier | None) -> tuple[float, float]:
    """Median and 99th percentile, ms, from when a frame was due until its command was there."""
    runner, delays = NavigatorRunner(NavigatorOptions("published"), rectifier.rig if rectifier else RIG, 30.0), []
    with StereoCameras(CameraSettings(left=names[0], right=names[1], max_age_ms=10_000), rectifier) as cameras:
        while True:
            try:
                frames = cameras.read()
            except FramesEnded:
                break
            runner.step(frames, STILL)
            delays.append(time.monotonic() - frames.time)
    p50, p99 = np.percentile(np.array(delays[10:]) * 1e3, (50, 99))
    return float(p50), float(p99)


def rows(device: str | None = None) -> list[Row]:
    """The table."""
    cv2.setNumThreads(1)
    rectifier = Rectifier(calibration(), RIG)
    images = stereo_pair(0)
    frames = [to_tensor(image) for image in images]
    maps = cv2.initUndistortRectifyMap(
        calibration().left.matrix, calibration().left.distortion, np.eye(3), np.eye(3) * 430, (640, 480), cv2.CV_32FC1
    )
    strips = [cut_strips(frame, field, RIG) for frame, field in zip(frames, RIG.subfields(), strict=True)]
    found = []
    with tempfile.TemporaryDirectory() as folder, torch.inference_mode():
        names = films(Path(folder), 300)
        for what, use in (("as they are", None), ("corrected strips", rectifier)):
            p50, p99 = frame_to_command(names, use)
            found.append(
                Row(
                    f"frame to command, {what}: median and 99 %",
                    f"{p50:.1f}, {p99:.1f} ms",
                    "10 ms",
                    f"{10 / p99:.1f}x",
                )
            )
        runner = NavigatorRunner(NavigatorOptions("published"), RIG, 30.0)
        seen = StereoFrames(Strips(*strips[0]), Strips(*strips[1]), 0.0)
        runner.step(seen, STILL)
        taken = Step(0, 0.0, seen, STILL, STILL, STILL, runner.state)
        with (
            Recorder(Path(folder) / "r.mcap", runner, queue=10) as recorder,
            Unqueued(Path(folder) / "w.mcap", runner) as thread,
        ):
            jobs = {
                "navigate": lambda: runner.step(seen, STILL),
                "record": lambda: recorder(taken),
                "write": lambda: thread.step(taken),
                "strips": lambda: rectifier.strips(*images),
                "whole": lambda: [cv2.remap(image, *maps, cv2.INTER_CUBIC) for image in images],
            }
            times = in_turn(jobs)
    us = {name: 1e6 * seconds for name, seconds in times.items()}

    def row(what: str, name: str, against: str, other: str) -> Row:
        return Row(what, f"{us[name]:.0f} us", against, f"{us[other] / us[name]:.2f}x")

    return [
        *found,
        row("correct the strips of both pictures", "strips", "both whole pictures", "whole"),
        row("record a step, in the loop", "record", "navigation step", "navigate"),
        row("record a step, in the thread", "write", "navigation step", "navigate"),
    ]


if __name__ == "__main__":
    torch.set_num_threads(1)
    print(table(TITLE, rows()))
