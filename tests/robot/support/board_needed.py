"""A mark for tests that run the firmware on the simulated processor: skipped, with the reason, where that fails."""

import shutil
import subprocess
from pathlib import Path

import pytest

FIRMWARE = Path(__file__).resolve().parents[3] / "robot" / "firmware"


def reason():
    if shutil.which("avr-gcc") is None or not Path("/usr/include/simavr/sim_avr.h").exists():
        return "needs gcc-avr avr-libc libsimavr-dev libelf-dev (Debian packages)"
    made = subprocess.run(["make", "-s", "-C", FIRMWARE, "sim"], capture_output=True, text=True, check=False)
    return "" if made.returncode == 0 else f"the firmware cannot be built: {made.stderr[-300:]}"


WHY = reason()
needs_board = pytest.mark.skipif(bool(WHY), reason=WHY)
