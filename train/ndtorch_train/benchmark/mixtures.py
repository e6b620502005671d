"""`ndtorch benchmark mixtures`: blind separation of five sources from ten mixtures, for which the network is not made.

Sources are those of CorInfoMax (Bozkurt et al., ICLR 2023): uniform, dependent by a copula of Student's t with four
degrees of freedom and correlations `c ** |i - j|`. Mixtures are Gaussian, or such as the ten signals are: each source
leads two inputs with gain 1 and leaks into the others with gains up to .3. Noise is 30 dB below.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from scipy import stats
from scipy.optimize import linear_sum_assignment

from ndtorch.binding import InhibitoryNetwork
from ndtorch.binding.learning import settled
from ndtorch.errors import InputError
from ndtorch.utils.packages import need
from ndtorch_train.benchmark.base import Benchmark, Column, Split, Task
from ndtorch_train.rows import Row

Floats = npt.NDArray[np.float64]

SOURCES, INPUTS = 5, 10
FREEDOM = 4
LEAK = 0.3
NOISE_DB = 30.0
DT = 0.01
"""Seconds between samples, for the time constants of the network."""
CORRELATIONS = (0.0, 0.2, 0.4, 0.6)
FIRST_SEED = {"tune": 50_000_000, "test": 51_000_000}


def draw_sources(rng: np.random.Generator, samples: int, correlation: float) -> Floats:
    """Uniform sources `[T, 5]` from 0 to 1."""
    apart = np.abs(np.subtract.outer(np.arange(SOURCES), np.arange(SOURCES)))
    factor = np.linalg.cholesky(float(correlation) ** apart)
    normal = rng.standard_normal((samples, SOURCES)) @ factor.T
    return np.asarray(stats.t.cdf(normal / np.sqrt(rng.chisquare(FREEDOM, (samples, 1)) / FREEDOM), FREEDOM))


def draw_mixing(rng: np.random.Generator, kind: str) -> Floats:
    """Gains `[10, 5]`."""
    if kind == "gaussian":
        return rng.standard_normal((INPUTS, SOURCES))
    gains = rng.uniform(0, LEAK, (INPUTS, SOURCES))
    gains[np.arange(INPUTS), np.arange(INPUTS) % SOURCES] = 1
    return gains


def sinr(outputs: Floats, sources: Floats) -> float:
    """Mean signal to interference and noise of the sources in outputs `[T, N]`, dB; each in an output of its own."""
    r = np.corrcoef(outputs.T, sources.T)[: outputs.shape[1], outputs.shape[1] :] ** 2
    level = 10 * np.log10(np.nan_to_num(r).clip(1e-9, 1 - 1e-9) / (1 - np.nan_to_num(r).clip(1e-9, 1 - 1e-9)))
    return float(level[linear_sum_assignment(level, maximize=True)].mean())


def inhibitory(make: Callable[..., InhibitoryNetwork], **options: Any) -> Callable[[Floats], Floats]:
    """Outputs by the weights that a network has learned at the end."""

    def separate(mixed: Floats) -> Floats:
        inputs = torch.from_numpy(mixed / mixed.std())
        with torch.inference_mode():
            _, state = make(INPUTS, DT, **options)(inputs)
        return np.asarray((inputs @ settled(state.weights).mT).numpy())

    return separate


def fast_ica(mixed: Floats) -> Floats:
    """As many independent components as there are sources."""
    ica = need("sklearn.decomposition", "ica").FastICA(SOURCES, whiten="unit-variance", random_state=0, max_iter=400)
    return np.asarray(ica.fit_transform(mixed))


METHODS: Mapping[str, Callable[[Floats], Floats]] = {
    "mixtures as they are": lambda mixed: mixed,
    "competitive network": inhibitory(InhibitoryNetwork),
    "scale-free network": inhibitory(InhibitoryNetwork.scale_free),
    "FastICA": fast_ica,
}


def measure(kind: str, method: str, split: Split, draws: int, samples: int, out: Path) -> list[Row]:
    """The row of a method on one kind of mixtures: mean SINR at each correlation."""
    row: Row = {"case": kind, "method": method}
    for correlation in CORRELATIONS:
        levels = []
        for n in range(draws):
            rng = np.random.default_rng(FIRST_SEED[split] + n)
            sources = draw_sources(rng, samples, correlation)
            clean = sources @ draw_mixing(rng, kind).T
            noise = rng.standard_normal(clean.shape) * clean.std(0) * 10 ** (-NOISE_DB / 20)
            levels.append(sinr(METHODS[method](clean + noise), sources))
        row[f"c{correlation:g}"] = float(np.mean(levels))
    return [row]


COLUMNS = (
    Column("case", "mixtures"),
    Column("method", "method"),
    *(Column(f"c{c:g}", f"SINR at {c:g}, dB", 1, better=1) for c in CORRELATIONS),
)


def mixture_benchmark(draws: int, samples: int, split: Split) -> Benchmark:
    """The benchmark of all methods on both kinds of mixtures."""
    if not (1 <= draws <= 1000 and 1000 <= samples <= 10_000_000):
        raise InputError(f"mixtures must be 1 to 1000 of 1000 to 10000000 samples, got {draws} of {samples}")
    tasks = [
        Task(f"{kind}, {method}", functools.partial(measure, kind, method, split, draws, samples))
        for kind in ("gaussian", "leading")
        for method in METHODS
    ]
    note = f"Split {split}, {draws} mixtures of {samples} samples."
    settings = {"split": split, "mixtures": draws, "samples": samples}
    return Benchmark("mixtures", "Blind separation", note, COLUMNS, tasks, ("ndtorch.binding",), settings=settings)
