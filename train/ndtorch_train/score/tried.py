"""What the dissertation names as next, tried once: divisive inhibition, learned f and g, opponent inputs, a third layer.

python -m ndtorch_train.score.tried --scenes 6          # the table, tune split
python -m ndtorch_train.score.tried --learn             # f and g by gradient through the network, printed
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from ndtorch.binding import object_table
from ndtorch.binding.network import InhibitoryNetwork
from ndtorch.binding.rules import LearningRule, cube, tanh_pi, within_radius
from ndtorch_train.score.hard import HARD, hard_trial
from ndtorch_train.score.methods import Learned, Reading, ScaleFree, Signals, first_stage
from ndtorch_train.score.scenes import FPS, Restriction, draw_scene, superposed

SETTLE = 4.0
BASES: tuple[Callable[[Tensor], Tensor], ...] = (
    lambda x: x,
    lambda x: x**3,
    lambda x: torch.tanh(torch.pi * x),
    lambda x: torch.tanh(10 * x),
    lambda x: x * x.abs(),
)
PUBLISHED_ROW, PUBLISHED_COLUMN = (0.0, 0.0, 1.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0, 0.0)


def resampled(sums: Tensor, fps: float) -> Tensor:
    """At 100 samples a second, as the published network runs; each frame stays until the next."""
    return sums.repeat_interleave(round(FPS / fps), 1)


class Divisive:
    """o = i / (1 + s W |o|), settled by eight steps; the competitive rule."""

    online = True

    def __init__(self, strength: float, gamma: float = 0.5) -> None:
        self.strength, self.gamma = strength, gamma

    def __call__(self, sums: Tensor, fps: float, times: Sequence[float]) -> list[Reading]:
        refined = Signals(FPS)(resampled(sums, fps))
        batch, steps, _ = refined.shape
        weights, out = torch.zeros(batch, 10, 10), torch.zeros(batch, 10)
        off, readings = 1 - torch.eye(10), []
        wanted = [round(time * FPS) for time in times]
        mean = torch.zeros(batch, 10)
        with torch.inference_mode():
            for n in range(steps):
                for _ in range(2):
                    out = refined[:, n] / (1 + self.strength * (weights @ out.abs().unsqueeze(-1)).squeeze(-1))
                mean = mean + 0.01 * (out - mean)
                high = out - mean
                if n > SETTLE * FPS:
                    mu = 1 - torch.exp(torch.tensor(-(n / FPS - SETTLE) / 2))
                    grown = (
                        weights + self.gamma / FPS * mu * tanh_pi(high).unsqueeze(-1) * cube(high).unsqueeze(-2) * off
                    )
                    weights = within_radius(grown.clamp(0, 10), 0.95)[0]
                if n + 1 in wanted:
                    table = object_table(weights)
                    found = [rows[own] > 0 for rows, own in zip(table.rows, table.owners, strict=True)]
                    readings.append(Reading(found, torch.zeros(batch, dtype=torch.bool)))
        return readings


def mixed(shares: Tensor) -> Callable[[Tensor], Tensor]:
    """An odd function: so much of each of `BASES`."""
    return lambda x: torch.stack([share * base(x) for share, base in zip(shares, BASES, strict=True)]).sum(0)


class LearnedFunctions:
    """The published network with f and g found by gradient."""

    online = True

    def __init__(self, row: Tensor, column: Tensor) -> None:
        self.row, self.column = row, column

    def __call__(self, sums: Tensor, fps: float, times: Sequence[float]) -> list[Reading]:
        refined = Signals(FPS)(resampled(sums, fps))
        rule = LearningRule(mixed(self.row), mixed(self.column), gamma=0.5)
        network, state, done, readings = InhibitoryNetwork(10, 0.01, rule, settle=SETTLE), None, 0, []
        with torch.inference_mode():
            for time in times:
                upto = round(time * FPS)
                _, state = network(refined[:, done:upto], state)
                done = upto
                table = object_table(state.weights)
                found = [rows[own] > 0 for rows, own in zip(table.rows, table.owners, strict=True)]
                readings.append(Reading(found, torch.zeros(len(sums), dtype=torch.bool)))
        return readings


def soft_count(weights: Tensor) -> Tensor:
    """The number of objects of [C §4.1], made smooth."""
    relative = weights / weights.flatten(1).amax(1).clamp_min(1e-6)[:, None, None]
    kept = relative * torch.sigmoid(30 * (relative - 1 / 3))
    return torch.sigmoid(10 * (kept.sum(-2) - 0.6)).sum(-1)


def learn(scenes: int = 96, rounds: int = 60) -> tuple[Tensor, Tensor]:
    """f and g of the competitive rule by gradient through the network: 10 s at 25 steps a second, tune scenes."""
    torch.manual_seed(0)
    chosen = [draw_scene(n, Restriction()) for n in range(scenes)]
    refined = Signals(FPS)(superposed(chosen, SETTLE + 10.0))[:, round(SETTLE * FPS) :: 4].clone()
    truth = torch.tensor([len(scene.bars) for scene in chosen], dtype=torch.float32)
    row = torch.tensor(PUBLISHED_ROW, requires_grad=True)
    column = torch.tensor(PUBLISHED_COLUMN, requires_grad=True)
    optimiser, off = torch.optim.Adam([row, column], 0.05), 1 - torch.eye(10)
    for n in range(rounds):
        pick = torch.randperm(scenes)[:32]
        inputs, a, b = refined[pick], mixed(row), mixed(column)
        weights, mean, out = torch.zeros(32, 10, 10), torch.zeros(32, 10), torch.zeros(32, 10)
        for k in range(inputs.shape[1]):
            out = inputs[:, k] - (weights @ out.unsqueeze(-1)).squeeze(-1)
            mean = mean + 0.04 * (out - mean)
            high = (out - mean).clamp(-3, 3)
            mu = 1 - torch.exp(torch.tensor(-k / 25 / 2))
            grown = (weights + 0.5 / 25 * mu * a(high).unsqueeze(-1) * b(high).unsqueeze(-2) * off).clamp(0, 10)
            # The same limit, by the largest sum of a row: it bounds the radius, and has a gradient.
            weights = grown * (0.95 / grown.sum(-1).amax(-1).clamp_min(0.95))[:, None, None]
        loss = (soft_count(weights) - truth[pick]).square().mean()
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_([row, column], 1.0)
        optimiser.step()
        if n % 10 == 0 or n == rounds - 1:
            print(n, f"{float(loss.detach()):.3f}", row.tolist(), column.tolist(), flush=True)
    return row.detach(), column.detach()


class Opponent:
    """Opponent motion and colors before everything else: what goes left less what goes right, a color less the others."""

    online = True

    def __init__(self, method: Learned | ScaleFree) -> None:
        self.method = method

    def __call__(self, sums: Tensor, fps: float, times: Sequence[float]) -> list[Reading]:
        across, along = sums[..., 0] - sums[..., 1], sums[..., 2] - sums[..., 3]
        moved = torch.stack([across, -across, along, -along], -1).clamp_min(0)
        color = sums[..., 7:]
        apart = (color - (color.sum(-1, keepdim=True) - color) / 2).clamp_min(0)
        return self.method(torch.cat([moved, sums[..., 4:7], apart], -1), fps, times)


class Third:
    """Glomeruli: networks that see the same at other paces; a third layer takes the number most of them agree upon."""

    online = True

    def __init__(self, methods: Sequence[Learned | ScaleFree | Paced]) -> None:
        self.methods = methods

    def __call__(self, sums: Tensor, fps: float, times: Sequence[float]) -> list[Reading]:
        every = [one(sums, fps, times) for one in self.methods]
        readings = []
        for moment in zip(*every, strict=True):
            found = []
            for trial in zip(*(reading.found for reading in moment), strict=True):
                count = sorted(len(objects) for objects in trial)[len(trial) // 2]
                found.append(next(objects for objects in trial if len(objects) == count))
            readings.append(Reading(found, moment[0].alternating))
        return readings


class Paced:
    """One glomerulus: sums smoothed over so many seconds, before one of the models."""

    def __init__(self, method: Learned | ScaleFree, seconds: float) -> None:
        self.method, self.seconds = method, seconds

    def __call__(self, sums: Tensor, fps: float, times: Sequence[float]) -> list[Reading]:
        width = max(1, round(self.seconds * fps))
        padded = torch.cat([sums[:, :1].expand(-1, width - 1, -1), sums], 1)
        return self.method(padded.unfold(1, width, 1).mean(-1), fps, times)


METHODS = {
    "published": lambda: Learned("competitive"),
    "divisive 1": lambda: Divisive(1.0),
    "divisive 5": lambda: Divisive(5.0),
    "divisive 20, fast": lambda: Divisive(20.0, 2.0),
    "learned f, g": lambda: LearnedFunctions(*learned_shares()),
    "opponent, published": lambda: Opponent(Learned("competitive")),
    "third, published": lambda: Third([Paced(Learned("competitive"), s) for s in (0.0, 0.08, 0.16, 0.3, 0.5)]),
    "owners": lambda: ScaleFree("owners"),
    "opponent, owners": lambda: Opponent(ScaleFree("owners")),
    "third, owners": lambda: Third([Paced(ScaleFree("owners"), s) for s in (0.0, 0.08, 0.16, 0.3, 0.5)]),
    "scale-free": lambda: ScaleFree("sums"),
    "opponent, scale-free": lambda: Opponent(ScaleFree("sums")),
}
LEARNED: list[Tensor] = []


def learned_shares() -> list[Tensor]:
    """Learned once."""
    if not LEARNED:
        LEARNED.extend(learn())
    return LEARNED


def main() -> None:
    """Print the table."""
    ask = argparse.ArgumentParser()
    ask.add_argument("--scenes", type=int, default=6)
    ask.add_argument("--learn", action="store_true")
    ask.add_argument("--methods", nargs="*", default=list(METHODS))
    options = ask.parse_args()
    torch.set_num_threads(1)
    if options.learn:
        learn()
        return
    made = {name: METHODS[name]() for name in options.methods}
    print("| hard set | " + " | ".join(made) + " |\n|" + "---|" * (len(made) + 1), flush=True)
    total = {name: [0, 0] for name in made}
    for hard in HARD:
        trial = hard_trial(hard, "tune", options.scenes, first_stage())
        cells = []
        for name, one in made.items():
            at = SETTLE + hard.seconds
            found = one(trial.sums, trial.fps, [at])[0].found
            from ndtorch_train.score.metrics import score_scene

            scores = [score_scene(a, b) for a, b in zip(found, trial.truth, strict=True)]
            count, ok = sum(s.counted for s in scores), sum(s.ok for s in scores)
            total[name][0] += count
            total[name][1] += ok
            cells.append(f"{count / len(scores):.2f} ({ok / len(scores):.2f})")
        print(f"| {hard.name} | " + " | ".join(cells) + " |", flush=True)
    n = options.scenes * len(HARD)
    print("| all | " + " | ".join(f"{c / n:.2f} ({o / n:.2f})" for c, o in total.values()) + " |")


if __name__ == "__main__":
    main()
