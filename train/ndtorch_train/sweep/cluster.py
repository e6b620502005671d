"""The same work on a Ray cluster."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ndtorch.errors import InputError
from ndtorch.loading import model_folders
from ndtorch.utils.packages import need
from ndtorch.utils.workers import TRIES, Event

PACKAGES = ("ndtorch", "ndtorch_robot", "ndtorch_train")
"""What the machines of a cluster get a copy of."""

LEFT_OUT = [".git", ".venv", "out", ".mypy_cache", ".pytest_cache", ".ruff_cache", ".hypothesis", "**/__pycache__"]
"""What of a checkout the machines of the cluster do not get."""


def run_on_ray(
    function: Callable[[Any], Any], tasks: Sequence[Any], address: str | None, jobs: int | None
) -> Iterator[Event]:
    """Call `function(task)` for every task on a Ray cluster; events as of `run_tasks`, without progress.

    Args:
        function: found by its name in this code, of which every machine gets a copy.
        tasks: whatever can be pickled.
        address: of a running cluster ("auto" finds one here); None starts one on this machine.
        jobs: processes of a cluster that is started here.

    Raises:
        InputError: Ray is not installed, or no cluster answers.
    """
    ray = need("ray", "--cluster")
    environment: dict[str, Any] = {"env_vars": {"OMP_NUM_THREADS": "1"}}
    options: dict[str, Any] = {"log_to_driver": False, "include_dashboard": False}
    if address is None:
        # On this machine the workers read this very code.
        places = [str(folder.parent) for folder in package_folders()]
        environment["env_vars"]["PYTHONPATH"] = os.pathsep.join([*places, os.environ.get("PYTHONPATH", "")])
        options["num_cpus"] = jobs
    else:
        environment |= code_to_send(package_folders())
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


def package_folders() -> list[Path]:
    """Where the three packages lie on this machine."""
    specs = [find_spec(name) for name in PACKAGES]
    return [Path(place) for spec in specs if spec is not None for place in spec.submodule_search_locations or ()]


def code_to_send(folders: Sequence[Path]) -> dict[str, Any]:
    """Ray's words for the code to copy: the installed packages, or the checkout where the models lie beside them."""
    models = next(iter(model_folders().values())).parent
    if any(models.is_relative_to(folder) for folder in folders):
        return {"py_modules": [str(folder) for folder in folders]}
    root = models.parent
    inside = [str(folder.parent.relative_to(root)) for folder in folders]
    return {
        "working_dir": str(root),
        "excludes": LEFT_OUT,
        "env_vars": {"OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(inside)},
    }


def _one_thread(function: Callable[[Any], Any], task: Any) -> Any:
    import torch

    torch.set_num_threads(1)
    return function(task)
