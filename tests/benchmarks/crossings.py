"""Who is who in generated clips of objects that cross: `python -m tests.benchmarks.crossings FIRST LAST MOST [MODEL]`.

Of the clips that `ndtorch benchmark foreground --generated N` draws with these seeds of the split tune, two to four
objects at 12.5 and 25 frames a second, the first MOST are taken in which two objects overlap by a fifth of their
sizes. A true object counts as there while 30 % of it shows.

The model gets the frames as they are drawn. An encoder would add its blocks, and each version of it adds others: on the
same clips IDF1 differed by .07. The checksum in the last line says whether two runs had the same frames.
"""

import sys
import zlib
from collections.abc import Iterator

import cv2
import numpy as np
import torch

from ndtorch_train.benchmark.foreground import run_method
from ndtorch_train.benchmark.generated_clips import Clip, Mover, Painter, bounding_box, draw_clip, shown
from ndtorch_train.benchmark.mot import Pixels, TrueBox, TrueFrame, Video, mot_score

IN_VIEW, THERE, OVERLAP = 0.7, 0.3, 0.8


def meet(one: Mover, other: Mover, time: float, width: float) -> bool:
    if min(shown(one, time, width, ()), shown(other, time, width, ())) <= IN_VIEW:
        return False
    apart = np.abs(np.array(one.position(time)) - np.array(other.position(time)))
    return bool((apart < OVERLAP / 2 * (np.array(one.size) + np.array(other.size))).all())


def crosses(clip: Clip) -> bool:
    width, pairs = clip.size[1] / clip.size[0], [(a, b) for i, a in enumerate(clip.movers) for b in clip.movers[:i]]
    return any(meet(a, b, float(time), width) for time in np.arange(0, clip.seconds, 0.1) for a, b in pairs)


def truth(clip: Clip) -> Iterator[TrueFrame]:
    height, width = clip.size[0], clip.size[1] / clip.size[0]
    for n in range(clip.frames):
        time = n / clip.fps
        there = [k for k, one in enumerate(clip.movers) if shown(one, time, width, clip.occluders) >= THERE]
        yield TrueFrame([TrueBox(k, bounding_box(clip.movers[k], time, height)) for k in there])


def chosen(first: int, last: int, most: int) -> list[Clip]:
    cells = ((seed, fps, count) for seed in range(first, last) for fps in (12.5, 25.0) for count in (2, 3, 4))
    clips = (clip for seed, fps, count in cells if crosses(clip := draw_clip("tune", seed, count, fps)))
    return [clip for clip, _ in zip(clips, range(most), strict=False)]


class Drawn:
    """The frames of a clip in blue, green, red; every loop over them draws the same ones again."""

    def __init__(self, clip: Clip) -> None:
        self.clip, self.checksum = clip, 0

    def __iter__(self) -> Iterator[Pixels]:
        self.checksum = 0
        for frame in Painter(self.clip).frames():
            self.checksum = zlib.crc32(frame.tobytes(), self.checksum)
            yield np.ascontiguousarray(frame[..., ::-1])


def main(first: int, last: int, most: int, model: str = "foreground") -> None:
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    rows, checksum = [], 0
    for clip in chosen(first, last, most):
        frames = Drawn(clip)
        seen = run_method(model, Video(clip.name, frames, clip.fps, clip.size))
        checksum = zlib.crc32(frames.checksum.to_bytes(4, "big"), checksum)
        found, tracks = (
            mot_score(seen, truth(clip), clip.fps, False),
            {s.track for frame in seen.hypotheses for s in frame},
        )
        rows.append((found.f, found.idf1 or 0.0, found.switches or 0, found.count_error, abs(len(tracks) - clip.count)))
        print(clip.name, *(f"{value:.2f}" for value in rows[-1]), flush=True)
    f, idf1, switches, count, wrong = np.array(rows, float).T
    print(f"{len(rows)} clips: F {f.mean():.3f}, IDF1 {idf1.mean():.3f}, switches {switches.sum():.0f}", end="")
    print(f", count error {count.mean():.3f}, tracks too many or few {wrong.sum():.0f}, frames {checksum:08x}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:4]), *sys.argv[4:])
