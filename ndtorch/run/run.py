"""The one loop over frames: any source, any model, with watchers, a report of progress and a clean stop."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ndtorch.binding import BindingModel, Verdict
from ndtorch.errors import InputError
from ndtorch.run.pictures import Glimpse, PictureMaker
from ndtorch.run.result import ClosedObjects, RunResult, Trace, one_matrix, over_fields
from ndtorch.run.watchers import Watcher
from ndtorch.scenes import FrameSource
from ndtorch.utils.tensors import give_back_freed_memory

TIDY_FRAMES = 500
"""Memory that runs leave in holes is handed back this often."""


def run_model(
    model: BindingModel,
    source: FrameSource,
    state: Any = None,
    start: int = 0,
    pictures_per_second: float = 5.0,
    watchers: Sequence[Watcher] = (),
    report: Callable[[int], None] | None = None,
    device: torch.device | str = "cpu",
) -> RunResult:
    """Feed a source through a model to its end, or until Ctrl-C, which keeps what was computed so far.

    Memory does not grow with the length of the source: frames are dropped as they are used, traces are thinned, and of
    the objects that were lost the latest are kept; watchers get all of them.

    Args:
        model: a binding model on `device`, made for the source's size and rate.
        source: frames `[T, 3, H, W]`.
        state: where an earlier run ended; None starts at rest.
        start: number of the first frame.
        pictures_per_second: how often watchers get a picture; 0 for never.
        watchers: who looks on.
        report: called with the number of frames of each chunk.
        device: where the model runs.

    Raises:
        InputError: a source that yields no frame or only one, or frames that the model refuses.
    """
    # Chunks end where a picture is due, so that the motion filters stand at its frame; long ones leave the cache.
    every = 8 if pictures_per_second <= 0 else max(1, round(source.fps / pictures_per_second))
    length = next(n for n in range(min(every, 12), 0, -1) if every % n == 0)
    outputs, weights = Trace((10,)), Trace((10, 10))
    cuts: list[float] = []
    frames_seen, now, interrupted, diverged, fresh = 0, 0.0, False, False, state is None
    maker = PictureMaker(model, every / source.fps, watchers, source.pixel_map)
    closed = ClosedObjects(model, watchers, maker.numbered)
    if model.tracks and state is not None:
        maker.numbered(model.objects(state))
    began = time.perf_counter()
    try:
        with torch.inference_mode(), maker:
            for frames in source.chunks(length, start):
                frames = frames.to(device)
                signals, after = model(frames, state)
                # The limit on the radius keeps no non-normal weights from blowing up: stop at the last numbers.
                if state is not None and not torch.isfinite(signals.outputs).all():
                    diverged = True
                    break
                maker.appeared(signals)
                state = closed.take(after)
                frames_seen += len(frames)
                now = float(signals.time[-1]) if len(signals.time) else now
                learned = one_matrix(model.weights(state))
                trace(outputs, weights, signals, learned)
                cuts += signals.time[signals.cut].tolist() if hasattr(signals, "cut") else []
                for watcher in watchers:
                    watcher.signals(signals, learned, state)
                # Enhanced images need outputs of this very chunk; tracks do not.
                due = pictures_per_second > 0 and frames_seen % every == 0
                if due and (model.tracks or len(signals.time) > 0):
                    table = None if model.tracks else model.table(state)
                    large = source.latest() if model.tracks else None
                    maker.look(Glimpse(now, frames[-1].clone(), signals, state, table, large))
                if report is not None:
                    report(len(frames))
                if frames_seen // TIDY_FRAMES > (frames_seen - len(frames)) // TIDY_FRAMES:
                    give_back_freed_memory()
    except KeyboardInterrupt:
        if state is None:
            raise
        interrupted = True
    if state is None or frames_seen == 0:
        raise InputError(f"{source.name}: no frames from frame {start} on")
    if fresh and frames_seen == 1 and not interrupted:
        raise InputError(f"{source.name}: one frame cannot show motion; a model needs two frames at least")
    with torch.inference_mode():
        verdict: Verdict = "alternating" if diverged else model.verdict(state)
        confidence = None if diverged else model.confidence(state)
        closed.tell([] if diverged else model.objects(state))
        state = closed.restored(state)
        found = [] if diverged else model.objects(state)
        table = None if model.tracks else model.table(state)
        final = one_matrix(model.weights(state)).cpu().float().numpy().astype(np.float32)
    if model.tracks:
        found = maker.numbered(found)
    owners = {thing.index for thing in found}
    return RunResult(
        source=source.name,
        model=model.name,
        size=source.size,
        objects=found,
        verdict=verdict,
        table=table,
        state=state,
        settle=model.settle,
        simulated_seconds=frames_seen / source.fps,
        wall_seconds=time.perf_counter() - began,
        frames=frames_seen,
        outputs=outputs,
        weights=weights,
        final_weights=final,
        moments={k: moment for k, moment in maker.moments.items() if k in owners},
        interrupted=interrupted,
        earlier=closed.earlier,
        cuts=tuple(apart(sorted([*cuts, *source.cuts]))),
        full_size=source.full_size,
        pixel_map=source.pixel_map,
        fps=source.fps,
        step_frames=model.dt * source.fps,
        first_frame=start,
        source_frames=source.decoded,
        masks=next((watcher for watcher in watchers if hasattr(watcher, "find")), None),
        silent=source.silent,
        confidence=confidence,
    )


def apart(times: Sequence[float], least: float = 1.0) -> list[float]:
    """Times in order, less those that follow the one before within `least` seconds: a fade is many new scenes."""
    return [now for before, now in zip([-math.inf, *times], times, strict=False) if now - before > least]


def trace(outputs: Trace, weights: Trace, signals: Any, learned: Tensor) -> None:
    """Keep the outputs of a chunk (of many fields, the largest of each neuron) and the weights after it."""
    times = signals.time.tolist()
    for at, sample in zip(times, over_fields(signals.outputs).cpu(), strict=True):
        outputs.add(at, sample)
    if times:
        weights.add(times[-1], learned)
