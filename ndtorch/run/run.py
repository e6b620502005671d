"""The one loop over frames: any source, any model, with watchers, a report of progress and a clean stop."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch

from ndtorch.binding import BindingModel, Verdict
from ndtorch.errors import InputError
from ndtorch.run.pictures import Objects, PictureMaker
from ndtorch.run.result import RunResult, Trace, Watcher, one_matrix, over_fields
from ndtorch.scenes import FrameSource


def run_model(
    model: BindingModel,
    source: FrameSource,
    state: Any = None,
    start: int = 0,
    pictures_per_second: float = 5.0,
    watchers: Sequence[Watcher] = (),
    report: Callable[[int], None] | None = None,
    device: torch.device | str = "cpu",
    most: int | None = None,
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
        most: frames to take; None for all.

    Raises:
        InputError: a source that yields no frame or only one, or frames that the model refuses.
    """
    # Chunks end where a picture is due, so that the motion filters stand at its frame; long ones leave the cache.
    every = 8 if pictures_per_second <= 0 else max(1, round(source.fps / pictures_per_second))
    length = next(n for n in range(min(every, 12), 0, -1) if every % n == 0)
    outputs, weights = Trace((10,)), Trace((10, 10))
    cuts: list[float] = []
    frames_seen, now, interrupted, diverged, fresh = 0, 0.0, False, False, state is None
    maker, kept = PictureMaker(model, source, every / source.fps, watchers), Objects(model, watchers)
    if state is not None:
        kept.numbered(model.objects(state))
    began = time.perf_counter()
    try:
        with torch.inference_mode():
            for frames in source.chunks(length, start):
                frames = frames[: None if most is None else most - frames_seen].to(device)
                signals, after = model(frames, state)
                # The limit on the radius keeps no non-normal weights from blowing up: stop at the last numbers.
                if state is not None and not torch.isfinite(signals.outputs).all():
                    diverged = True
                    break
                state = kept.take(signals, after)
                frames_seen += len(frames)
                learned, times = one_matrix(model.weights(state)), signals.time.tolist()
                for at, sample in zip(times, over_fields(signals.outputs).cpu(), strict=True):
                    outputs.add(at, sample)
                if times:
                    now = times[-1]
                    weights.add(now, learned)
                cuts += signals.time[signals.cut].tolist() if hasattr(signals, "cut") else []
                for watcher in watchers:
                    watcher.signals(signals, learned, state)
                # Enhanced images need outputs of this very chunk; tracks do not.
                due = pictures_per_second > 0 and frames_seen % every == 0
                if due and (model.tracks or times):
                    maker.take(now, frames[-1], signals, state, kept)
                if report is not None:
                    report(len(frames))
                if most is not None and frames_seen >= most:
                    break
    except KeyboardInterrupt:
        if state is None:
            raise
        interrupted = True
    maker.wait()
    if state is None or frames_seen == 0:
        raise InputError(f"{source.name}: no frames from frame {start} on")
    if fresh and frames_seen == 1 and not interrupted:
        raise InputError(f"{source.name}: one frame cannot show motion; a model needs two frames at least")
    with torch.inference_mode():
        verdict: Verdict = "alternating" if diverged else model.verdict(state)
        kept.tell([] if diverged else model.objects(state))
        state = kept.restored(state)
        objects = [] if diverged else kept.numbered(model.objects(state))
    cuts = sorted([*cuts, *source.cuts])
    # A fade is many new scenes.
    cuts = [now for before, now in itertools.pairwise([-1e9, *cuts]) if now - before > 1.0]
    owners = {thing.index for thing in objects}
    return RunResult(
        source=source.name,
        model=model.name,
        size=source.size,
        objects=objects,
        verdict=verdict,
        table=None if model.tracks else model.table(state),
        state=state,
        settle=model.settle,
        simulated_seconds=frames_seen / source.fps,
        wall_seconds=time.perf_counter() - began,
        frames=frames_seen,
        outputs=outputs,
        weights=weights,
        final_weights=one_matrix(model.weights(state)).cpu().float().numpy().astype(np.float32),
        moments={k: moment for k, moment in maker.moments.items() if k in owners},
        interrupted=interrupted,
        cuts=tuple(cuts),
        earlier=kept.earlier,
        full_size=source.full_size,
        pixel_map=source.pixel_map,
        fps=source.fps,
        step_frames=model.dt * source.fps,
        first_frame=start,
        source_frames=source.decoded,
        masks=next((watcher for watcher in watchers if hasattr(watcher, "find")), None),
        silent=source.silent,
        confidence=None if diverged else model.confidence(state),
    )
