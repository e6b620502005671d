"""The one loop over frames: any source, any model, with watchers, a report of progress and a clean stop."""

from __future__ import annotations

import itertools
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from ndtorch.binding import BindingModel, BoundObject, Verdict
from ndtorch.errors import InputError
from ndtorch.run.pictures import PictureMaker
from ndtorch.run.result import MaskStore, RunResult, Trace, Watcher
from ndtorch.scenes import FrameSource


def run_model(
    model: BindingModel,
    source: FrameSource,
    state: Any = None,
    start: int = 0,
    pictures_per_second: float | None = None,
    watchers: Sequence[Watcher] = (),
    report: Callable[[int], object] | None = None,
    device: torch.device | str = "cpu",
    most: int | None = None,
) -> RunResult:
    """Feed a source through a model to its end, or until Ctrl-C, which keeps what was computed so far.

    Frames are dropped as they are used. Kept are the outputs of the network, 50 bytes a step, every sighting of tracks,
    100 bytes each, and the latest masks.

    Args:
        model: a binding model on `device`, made for the source's size and rate.
        source: frames `[T, 3, H, W]`.
        state: where an earlier run ended; None starts at rest.
        start: number of the first frame.
        pictures_per_second: how often watchers get a picture; 0 for never, None for `picture_interval`.
        watchers: who looks on.
        report: called with the number of frames of each chunk.
        device: where the model runs.
        most: frames to take; None for all.

    Raises:
        InputError: a source that yields no frame or only one, or frames that the model refuses.
    """
    every = picture_interval(model, source, pictures_per_second)
    # Chunks end where a picture is due, so that the state is that of its frame, where rows are not of every frame; long
    # ones leave the cache.
    chunk = every or 8
    length = 8 if model.group else next(n for n in range(min(chunk, 12), 0, -1) if chunk % n == 0)
    rows = list[tuple[np.ndarray[Any, Any], ...]]()
    cuts: list[float] = []
    frames_seen, now, interrupted, diverged, fresh = 0, 0.0, False, False, state is None
    maker, masks = PictureMaker(model, source, chunk / source.fps, watchers), MaskStore()
    sightings: dict[int | None, list[tuple[float, float, float]]] = defaultdict(list)
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
                state = after
                frames_seen += len(frames)
                learned, times = one_matrix(model.weights(state)), signals.time.tolist()
                outs = signals.outputs if signals.outputs.ndim == 2 else signals.outputs.flatten(1, -2).amax(1)
                rows.append((np.array(times), outs.float().cpu().numpy()))
                if times:
                    now = times[-1]
                if hasattr(signals, "labels"):
                    cuts += signals.time[signals.cut].tolist()
                    masks.add(signals.time, signals.labels)
                elif model.tracks:
                    for one in model.visible_objects(state):
                        sightings[one.track].append((now, *(one.place or (0.0, 0.0))))
                for watcher in watchers:
                    watcher.signals(signals, learned, state)
                if every and model.tracks:
                    maker.show(frames, start + frames_seen - len(frames), every)
                elif every and frames_seen % every == 0 and times:
                    maker.take(now, frames[-1], signals, state)
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
        objects = [] if diverged else numbered(model.objects(state), sightings)
    cuts = sorted([*cuts, *source.cuts])
    # A fade is many new scenes.
    cuts = [now for before, now in itertools.pairwise([-1e9, *cuts]) if now - before > 1.0]
    owners = {thing.index for thing in objects}
    return RunResult(
        model,
        source,
        state,
        objects,
        verdict,
        frames_seen,
        start,
        time.perf_counter() - began,
        Trace(*map(np.concatenate, zip(*rows, strict=True))),
        one_matrix(model.weights(state)).cpu().float().numpy().astype(np.float32),
        {k: moment for k, moment in maker.moments.items() if k in owners},
        masks,
        interrupted,
        tuple(cuts),
        None if diverged else model.confidence(state),
    )


def picture_interval(model: BindingModel, source: FrameSource, rate: float | None) -> int:
    """Frames from one picture to the next, 0 for none. Without a rate, every step of a model with rows of every frame,
    and 5 a second of others."""
    step = model.group or 1
    rate = (source.fps / step if model.group else 5.0) if rate is None else rate
    return step * max(1, round(source.fps / step / rate)) if rate > 0 else 0


def numbered(things: Sequence[BoundObject], sightings: dict[int | None, list[Any]]) -> list[BoundObject]:
    """The objects in the order in which they were first known to be objects, with numbers from 1, which stay when a
    run goes on; those without a path get the sightings of their track."""

    def known_since(thing: BoundObject) -> float:
        states = zip(thing.path, thing.states, strict=False)
        return next((at[0] for at, state in states if state != "tentative"), thing.first_seen or 0.0)

    found = []
    for number, thing in enumerate(sorted(things, key=known_since), 1):
        path = thing.path or tuple(at for at in sightings[thing.track] if at[0] >= (thing.first_seen or 0.0) - 1e-6)
        since = thing.first_seen if thing.path or not path else path[0][0]
        found.append(replace(thing, number=number, path=path, first_seen=since))
    return found


def one_matrix(weights: torch.Tensor) -> torch.Tensor:
    """Weights `[10, 10]` as they are; of models with a matrix a window, `[K, 10, 10]`, the largest of each."""
    return weights if weights.ndim == 2 else weights.amax(0)
