"""The same work on a Ray cluster."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from ndtorch.errors import InputError
from ndtorch_train.reproduce.lab import ROOT
from ndtorch_train.workers import TRIES, Event

LEFT_OUT = [".git", ".venv", "out", ".mypy_cache", ".pytest_cache", ".ruff_cache", ".hypothesis", "**/__pycache__"]
"""What of the checkout the machines of the cluster do not get."""


def run_on_ray(
    function: Callable[[Any], Any], tasks: Sequence[Any], address: str | None, jobs: int | None
) -> Iterator[Event]:
    """Call `function(task)` for every task on a Ray cluster; events as `train.workers.run_tasks`, without progress.

    Args:
        function: found by its name in this checkout, which every machine gets a copy of.
        tasks: whatever can be pickled.
        address: of a running cluster ("auto" finds one here); None starts one on this machine.
        jobs: processes of a cluster that is started here.

    Raises:
        InputError: Ray is not installed, or no cluster answers.
    """
    try:
        import ray
    except ImportError:
        raise InputError("--cluster needs Ray: pip install 'ndtorch[cluster]'") from None
    environment: dict[str, Any] = {"env_vars": {"OMP_NUM_THREADS": "1"}}
    options: dict[str, Any] = {"log_to_driver": False, "include_dashboard": False}
    if address is None:
        # On this machine the workers read this very checkout.
        environment["env_vars"]["PYTHONPATH"] = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
        options["num_cpus"] = jobs
    else:
        environment |= {"working_dir": str(ROOT), "excludes": LEFT_OUT}
        options = {"log_to_driver": False, "address": address}
    try:
        ray.init(runtime_env=environment, **options)
    except Exception as error:  # Ray raises plain exceptions when a cluster does not start
        raise InputError(f"--cluster {address or ''}: no Ray cluster ({str(error).splitlines()[0]})") from None
    try:
        # Ray begins a task again when its worker dies.
        remote = ray.remote(num_cpus=1, max_retries=TRIES - 1)(_one_thread)
        waiting = {remote.remote(function, task): n for n, task in enumerate(tasks)}
        while waiting:
            ready, _ = ray.wait(list(waiting))
            for reference in ready:
                index = waiting.pop(reference)
                try:
                    yield Event("done", index, ray.get(reference))
                except ray.exceptions.RayError as error:
                    yield Event("failed", index, str(error))
    finally:
        ray.shutdown()


def _one_thread(function: Callable[[Any], Any], task: Any) -> Any:
    import torch

    torch.set_num_threads(1)
    return function(task)
