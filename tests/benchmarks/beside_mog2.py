"""Time of `foreground` beside MOG2 with its contours: `python -m tests.benchmarks.beside_mog2 FOLDER [FRAMES]`.

Of each clip in FOLDER the first FRAMES (200) go through both in turn, 8 at a time, in one thread. Printed is the median
over these pieces of the ratio of their times, twice, and the median time of a frame of each. The figures get frames of
at most 448 rows, as `ndtorch benchmark foreground` gives them, MOG2 the clip's own.
"""

import sys
import time
from pathlib import Path

import cv2
import numpy as np
import torch

import ndtorch
from ndtorch.run.opening import CAMERA_MODELS
from ndtorch_train.benchmark.foreground import Subtraction, scaled_frames
from ndtorch_train.benchmark.mot import Video, clip_folders, read_clip

PIECE = 8


def pieces(clip: Video, count: int) -> list[tuple[float, float]]:
    """Seconds of a frame of `foreground` and of MOG2, piece by piece, without the first one."""
    whole = list(clip.frames)[:count]
    frames = list(scaled_frames(clip, min(clip.size[0], CAMERA_MODELS["foreground"])))[:count]
    model, state = ndtorch.load("foreground", size=frames[0].shape[:2], fps=clip.fps), None
    peer, found = Subtraction("mog2"), []
    for start in range(0, len(frames) - PIECE + 1, PIECE):
        chunk = torch.from_numpy(np.stack([frame[..., ::-1] for frame in frames[start : start + PIECE]]))
        began = time.thread_time()
        with torch.inference_mode():
            _, state = model(chunk.permute(0, 3, 1, 2), state)
        between = time.thread_time()
        for frame in whole[start : start + PIECE]:
            peer(frame)
        found.append(((between - began) / PIECE, (time.thread_time() - between) / PIECE))
    return found[1:]


def main(folder: str, count: str = "200") -> None:
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    for one in clip_folders(Path(folder)):
        clip, said = read_clip(one).clip, []
        for _ in range(2):
            own, peer = np.array(pieces(clip, int(count))).T
            ratio, times = np.median(own / peer), (1000 * np.median(own), 1000 * np.median(peer))
            said.append(f"{ratio:.2f} ({times[0]:.2f} and {times[1]:.2f} ms)")
        print(clip.name, *said, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
