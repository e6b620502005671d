"""Running the binding model over a source of frames, with attention, progress and a clean stop."""

from __future__ import annotations

import time
from collections.abc import Callable

import torch

from ndtorch.binding import BindingSignals, BindingState, Verdict, VisualBinding
from ndtorch.errors import InputError
from ndtorch.memory import give_back_freed_memory
from ndtorch.run.pictures import Glimpse, PictureMaker, Watcher
from ndtorch.run.result import BindResult, Trace
from ndtorch.scenes import FrameSource

# Memory that runs leave in holes is handed back this often.
TIDY_FRAMES = 500


def run_binding(
    model: VisualBinding,
    source: FrameSource,
    state: BindingState | None = None,
    start: int = 0,
    pictures_per_second: float = 5.0,
    watchers: tuple[Watcher, ...] = (),
    progress: Callable[[int], None] | None = None,
    device: torch.device | str = "cpu",
) -> BindResult:
    """Feed a source through the model to its end, or until Ctrl-C, which keeps what was computed so far.

    Memory does not grow with the length of the source: frames are dropped as they are used, and traces are
    thinned.

    Args:
        model: on `device`, made for the source's size and rate.
        source: frames `[T, 3, H, W]`.
        state: where an earlier run ended; None starts at rest.
        start: number of the first frame.
        pictures_per_second: rate of enhanced images; 0 for none.
        watchers: see `Watcher`.
        progress: called with the number of frames of each chunk.
        device: where the model runs.

    Raises:
        InputError: a source that yields no frame, or frames that the model refuses.
    """
    # Chunks end where a picture is due, so that the motion filters stand at its frame; long ones leave the cache.
    every = 8 if pictures_per_second <= 0 else max(1, round(source.fps / pictures_per_second))
    length = next(n for n in range(min(every, 12), 0, -1) if every % n == 0)
    outputs, weights = Trace((10,)), Trace((10, 10))
    frames_seen, interrupted, diverged = 0, False, False
    maker = PictureMaker(model, every / source.fps, watchers)
    began = time.perf_counter()
    try:
        with torch.inference_mode(), maker:
            for frames in source.chunks(length, start):
                frames = frames.to(device)
                signals, after = model(frames, state)
                # The limit on the radius keeps no non-normal weights from blowing up: stop at the last numbers.
                if state is not None and not torch.isfinite(after.second.outputs).all():
                    diverged = True
                    break
                state = after
                frames_seen += len(frames)
                _note(outputs, weights, signals, state)
                for watcher in watchers:
                    watcher.signals(signals, state.second.weights)
                due = pictures_per_second > 0 and frames_seen % every == 0 and len(signals.time) > 0
                if due and state.motion is not None:
                    maker.look(Glimpse(frames[-1], state.motion, signals, model.table(state)))
                if progress is not None:
                    progress(len(frames))
                if frames_seen // TIDY_FRAMES > (frames_seen - len(frames)) // TIDY_FRAMES:
                    give_back_freed_memory()
    except KeyboardInterrupt:
        if state is None:
            raise
        interrupted = True
    if state is None or frames_seen == 0:
        raise InputError(f"{source.name}: no frames from frame {start} on")
    verdict: Verdict = "alternating" if diverged else model.verdict(state)
    found = [] if diverged else model.objects(state)
    owners = {thing.index for thing in found}
    return BindResult(
        source=source.name,
        objects=found,
        verdict=verdict,
        state=state,
        settle=model.settle,
        table=model.table(state) if model.scale_free else None,
        simulated_seconds=frames_seen / source.fps,
        wall_seconds=time.perf_counter() - began,
        frames=frames_seen,
        outputs=outputs,
        weights=weights,
        moments={k: moment for k, moment in maker.moments.items() if k in owners},
        interrupted=interrupted,
    )


def _note(outputs: Trace, weights: Trace, signals: BindingSignals, state: BindingState) -> None:
    times = signals.time.tolist()
    for at, sample in zip(times, signals.outputs.cpu(), strict=True):
        outputs.add(at, sample)
    if times:
        weights.add(times[-1], state.second.weights)
