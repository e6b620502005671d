"""The networks alone, and the whole job from stimulus to table."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

import ndtorch
from ndtorch.binding import InhibitoryNetwork
from ndtorch.run.run import run_model
from ndtorch.scenes import two_bars
from ndtorch.vision import VisualFeatures
from tests.benchmarks.timing import Row, in_turn, reference

TITLE = "Binding"
STEPS = 100
TRIALS = 256


def rows(device: str | None = None) -> list[Row]:
    found = [*network_rows("cpu"), *model_rows(), *job_rows(), *process_rows()]
    if device is not None:
        found += network_rows(device, 1024)
    return found


def network_rows(device: str, trials: int = TRIALS) -> list[Row]:
    """One learned network, and a batch of them that see the scene at different moments."""
    model = ndtorch.load("published").to(device)
    features = VisualFeatures()
    sums, state = [], None
    with torch.inference_mode():
        for frames in two_bars(seconds=13.0).chunks():
            out, state = features(frames, state)
            sums.append(out)
        scene = torch.cat(sums).to(device)
        learned, trained = model.from_sums(scene)
        network: InhibitoryNetwork = model.second
        single = learned.refined[-STEPS:]
        delays = torch.arange(trials) % TRIALS * 2
        many = torch.stack([learned.refined[100 + d : 700 + d] for d in delays.tolist()])
        _, batch_state = network(many[:, : 600 - STEPS])
        batch = many[:, -STEPS:]
        other = InhibitoryNetwork.scale_free().to(device)
        _, other_state = other(learned.refined[:-STEPS])
        _, other_batch_state = other(many[:, : 600 - STEPS])
        times = in_turn(
            {
                "single": lambda: network(single, trained.second),
                "batch": lambda: network(batch, batch_state),
                "scale-free single": lambda: other(single, other_state),
                "scale-free batch": lambda: other(batch, other_batch_state),
            },
            rounds=7,
            repeat=1,
        )
    one, all_trials = times["single"] / STEPS, times["batch"] / STEPS
    return [
        Row(
            f"second stage on {device}, one network",
            f"{1e6 * one:.0f} us a step",
            "10 ms of signal",
            f"{0.01 / one:.0f}x",
        ),
        Row(
            f"second stage on {device}, {trials} trials at once",
            f"{1e6 * all_trials / trials:.2f} us a trial-step",
            "one at a time",
            f"{one * trials / all_trials:.0f}x",
        ),
        Row(
            f"scale-free rule on {device}, one network",
            f"{1e6 * times['scale-free single'] / STEPS:.0f} us a step",
            "published step",
            f"{times['scale-free single'] / times['single']:.2f}x its time",
        ),
        Row(
            f"scale-free rule on {device}, {trials} trials at once",
            f"{1e6 * times['scale-free batch'] / STEPS / trials:.2f} us a trial-step",
            "published step",
            f"{times['scale-free batch'] / times['batch']:.2f}x its time",
        ),
    ]


def model_rows(rounds: int = 7) -> list[Row]:
    """A second of two bars through two models: drawing, pixels and the rest, each as so many transforms a frame."""
    found = []
    for name in ("published", "retinotopic"):
        model = ndtorch.load(name)
        eyes = model.features if name == "published" else model.eyes
        follow = model.from_sums if name == "published" else model.from_fields
        samples: list[dict[str, float]] = []
        with torch.inference_mode():
            for _ in range(rounds):
                spent = dict.fromkeys(("drawing", "pixels", "networks", "transform"), 0.0)
                state, scene = None, two_bars(seconds=1.0)
                chunks = scene.chunks(8)

                def timed(part: str, job: Callable[..., Any], *given: Any, to: dict[str, float] = spent) -> Any:
                    start = time.thread_time()
                    out = job(*given)
                    to[part] += time.thread_time() - start
                    return out

                while (frames := timed("drawing", next, chunks, None)) is not None:
                    signals, motion = timed("pixels", eyes, frames, None if state is None else state.motion)
                    _, state = timed("networks", follow, signals, state)
                    state = state._replace(motion=motion)
                    for _ in range(len(frames)):
                        timed("transform", reference)
                samples.append(spent)
        middle = {part: statistics.median(sample[part] for sample in samples[1:]) for part in samples[0]}
        one = middle.pop("transform")
        whole = sum(middle.values())
        found.append(
            Row(
                f"{name}: drawing, model and networks of a frame",
                f"{10 * whole:.2f} ms, " + ", ".join(f"{part} {10 * taken:.2f}" for part, taken in middle.items()),
                f"real time; transform {10 * one:.2f} ms",
                f"{1 / whole:.1f}x; {whole / one:.1f} transforms",
                whole / one,
            )
        )
    return found


def job_rows() -> list[Row]:
    """Two bars from rendering to the table of objects, against real time."""
    found = []
    for pictures, what in ((0.0, "without pictures"), (5.0, "with 5 enhanced pictures a second")):
        speeds = []
        for _ in range(3):
            start = time.perf_counter()
            result = run_model(ndtorch.load("published"), two_bars(), pictures_per_second=pictures)
            speeds.append(result.simulated_seconds / (time.perf_counter() - start))
        speed = sorted(speeds)[1]
        found.append(
            Row(f"two bars, stimulus to table, {what}", f"{100 * speed:.0f} frames/s", "real time", f"{speed:.1f}x")
        )
    return found


def process_rows() -> list[Row]:
    """Whole processes, with compiled kernels: processor seconds from Enter to the end."""
    program = next(
        part for part in Path("README.md").read_text(encoding="utf-8").split("```python\n") if "two_bars" in part
    )
    with tempfile.TemporaryDirectory() as folder:
        jobs = {
            "the ten lines of README.md": [sys.executable, "-c", program.partition("```")[0]],
            "`ndtorch bind two-bars`": [sys.executable, "-m", "ndtorch", "bind", "two-bars", "--out", folder],
        }
        found = []
        for what, command in jobs.items():
            taken = []
            for _ in range(3):
                before = os.times()
                subprocess.run(command, check=True, capture_output=True)
                after = os.times()
                taken.append(sum(after[2:4]) - sum(before[2:4]))
            seconds = statistics.median(taken)
            found.append(Row(f"{what}, whole process", f"{seconds:.1f} s", "19 s of scene", f"{19 / seconds:.1f}x"))
    return found
