"""`python -m tests.fault_injection.long_film`: a day of a static camera on a model, its memory and time by the hour."""

from __future__ import annotations

import argparse
import gc
import sys
import time
from typing import Any

import numpy as np
import torch

import ndtorch
from tests.fault_injection.scenario import resident_megabytes

FPS, SIZE, LOOP_S, CHUNK = 10, (48, 64), 60, 10


def film(seed: int = 0) -> torch.Tensor:
    """One minute `[T, 3, h, w]` uint8 that ends as it began: six figures enter, cross one another and leave."""
    random, (height, width) = np.random.default_rng(seed), SIZE
    frames = np.full((LOOP_S * FPS, 3, height, width), 110, np.int16)
    frames += random.integers(-2, 3, frames.shape, dtype=np.int16)
    frames += random.integers(-20, 21, (1, 3, height // 4, width // 4), dtype=np.int16).repeat(4, 2).repeat(4, 3)
    for k in range(6):
        color, top = random.integers(0, 256, 3), int(random.integers(0, height - 14))
        tall, wide, pace = 8 + k, 6 + k % 3, (-1) ** k * float(random.uniform(8, 16)) / FPS
        for t in range(LOOP_S * FPS):
            since = (t - 9 * k * FPS) % (LOOP_S * FPS)
            left = round(-wide + since * pace if pace > 0 else width + since * pace)
            if -wide < left < width:
                frames[t, :, top : top + tall, max(0, left) : left + wide] = color[:, None, None]
    return torch.from_numpy(np.clip(frames, 0, 255).astype(np.uint8))


def size_of(state: Any) -> int:
    """Bytes of the tensors of a state."""
    if isinstance(state, torch.Tensor):
        return state.numel() * state.element_size()
    return sum(map(size_of, state)) if isinstance(state, tuple) else 0


def main(hours: int, seed: int) -> None:
    torch.set_num_threads(1)
    frames, state = film(seed), None
    model = ndtorch.load("foreground", size=SIZE, fps=FPS)
    chunks, closed = frames.split(CHUNK), 0
    print("hour | state KB, mean and largest | resident MB | CPU ms a frame | objects closed", flush=True)
    with torch.inference_mode():
        for hour in range(hours):
            began, sizes = time.process_time(), []
            for _ in range(3600 // LOOP_S):
                for chunk in chunks:
                    _, state = model(chunk, state)
                    things, state = model.take_closed(state)
                    closed += len(things)
                    sizes.append(size_of(state))
            spent = (time.process_time() - began) / (3600 * FPS)
            gc.collect()
            print(
                f"{hour + 1} | {np.mean(sizes) / 1e3:.1f} {max(sizes) / 1e3:.1f} | {resident_megabytes():.1f} | "
                f"{1e3 * spent:.3f} | {closed}",
                flush=True,
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=int, default=24)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(sys.argv[1:])
    main(given.hours, given.seed)
