"""Work for the workers: functions that a spawned process can import."""

import os
import time
from pathlib import Path

from ndtorch.errors import InputError


def work(job, progress):
    """`("double", n)`, `("die", file)`: only where the file is missing, `("always-die",)`, `("raise",)`, ..."""
    kind, *rest = job
    if kind == "double":
        progress(0.5)
        return 2 * rest[0]
    if kind == "die":
        marker = Path(rest[0])
        if not marker.exists():
            marker.touch()
            os.kill(os.getpid(), 9)
        return "alive"
    if kind == "always-die":
        os._exit(7)
    if kind == "unusable":
        raise InputError("no such thing")
    if kind == "sleep":
        time.sleep(600)
    raise ValueError("broken")
