"""False objects where nothing is: `python -m tests.benchmarks.empty FOLDER SPLIT SECONDS METHODS [KINDS] [CLIPS]`.

Over the median of each clip in FOLDER (at most 288 rows) every kind of clip of `ndtorch benchmark foreground
--negative` is drawn, once as it is, and once with a thing that crosses the picture in the second half. Printed are the
objects a minute of the first, all of them false, and of how many of the frames the second shows the thing in, its
place is told. METHODS, KINDS and CLIPS are names with commas between them; `all` kinds or clips are all.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch

from ndtorch_train.benchmark.base import Split
from ndtorch_train.benchmark.foreground import run_method
from ndtorch_train.benchmark.mot import Box, Pixels, TrueBox, TrueFrame, Video, clip_folders, mot_score
from ndtorch_train.benchmark.negative_clips import FPS, KINDS, SEEDS, Drawn, still_image

ROWS, TALL, WIDE = 288, 0.16, 0.09
"""Most rows of a still picture; height and width of the thing, shares of the picture's height."""


class Crossed:
    """A clip with a thing in its second half: two colors, one above the other, from side to side."""

    def __init__(self, frames: list[Pixels], seed: int) -> None:
        self.frames, chance = frames, np.random.default_rng((seed, 99))
        self.height, self.width = frames[0].shape[:2]
        self.row, self.right = chance.uniform(0.3, 0.7) * self.height, chance.uniform() < 0.5
        self.colors = chance.integers(10, 245, (2, 3)).tolist()

    def box(self, number: int) -> Box | None:
        """Its box, None while it is not in view."""
        half, wide, tall = len(self.frames) // 2, WIDE * self.height, TALL * self.height
        if number < half:
            return None
        share = (number - half) / (len(self.frames) - half)
        at = (share if self.right else 1 - share) * (self.width + wide) - wide / 2
        return Box(at - wide / 2, self.row - tall / 2, at + wide / 2, self.row + tall / 2)

    def __iter__(self) -> Iterator[Pixels]:
        for number, frame in enumerate(self.frames):
            box = self.box(number)
            if box is None:
                yield frame
                continue
            frame, middle = frame.copy(), (box.left + box.right) / 2
            axes = round(8 * (box.right - box.left)), round(8 * (box.bottom - box.top))
            at = round(16 * middle), round(16 * self.row)
            for color, turn in zip(self.colors, (180, 0), strict=True):
                cv2.ellipse(frame, at, axes, 0, turn, turn + 180, color, -1, cv2.LINE_AA, 4)
            yield frame

    def truth(self) -> Iterator[TrueFrame]:
        for number in range(len(self.frames)):
            box = self.box(number)
            yield TrueFrame([TrueBox(0, box)] if box else [])


def still_of(folder: Path) -> Pixels:
    still = still_image(folder / "clip.mp4")
    width = round(still.shape[1] * ROWS / len(still) / 8) * 8
    return still if len(still) <= ROWS else np.asarray(cv2.resize(still, (width, ROWS), interpolation=cv2.INTER_AREA))


def main(folder: str, split: Split, seconds: str, methods: str, kinds: str = "all", clips: str = "all") -> None:
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    names, table = methods.split(","), dict[tuple[str, str], list[Any]]()
    folders = [one for one in clip_folders(Path(folder)) if clips == "all" or one.name in clips.split(",")]
    wanted = list(KINDS) if kinds == "all" else kinds.split(",")
    for kind in wanted:
        for number, one in enumerate(folders):
            seed = SEEDS[split] + number
            frames = list(Drawn(kind, still_of(one), seed, round(float(seconds) * FPS)))
            crossed, size = Crossed(frames, seed), frames[0].shape[:2]
            for name in names:
                seen = run_method(name, Video(one.name, frames, FPS, (size[0], size[1])))
                false = len({sight.track for sights in seen.hypotheses for sight in sights})
                with_one = run_method(name, Video(one.name, crossed, FPS, (size[0], size[1])))
                found = mot_score(with_one, crossed.truth(), FPS, False).recall
                table.setdefault((kind, name), []).append((false / float(seconds) * 60, found))
                print(f"{kind} {one.name} {name}: {false} in {seconds} s, {found:.2f} found", flush=True)
    print("| | " + " | ".join(f"{name}: false a minute | found" for name in names) + " |")
    print("|---|" + "---|" * 2 * len(names))
    for kind in wanted:
        means = [np.mean(table[kind, name], 0) for name in names]
        print(f"| {kind} | " + " | ".join(f"{false:.1f} | {found:.2f}" for false, found in means) + " |")


if __name__ == "__main__":
    main(*sys.argv[1:])  # type: ignore[arg-type]
