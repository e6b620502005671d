"""`ndtorch doctor`."""

from __future__ import annotations

import contextlib
import json
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.metadata import PackageNotFoundError, requires, version
from typing import Literal

MARKS = {"works": "ok  ", "missing": "-   ", "fails": "FAIL"}

NEEDED = ("ndtorch", "torch", "numpy", "numba", "scipy", "cv2", "av", "serial", "mcap", "rosbags.typesys")
"""Modules without which something that is always promised does not work; they are loaded."""

OPTIONAL = {"gymnasium": "learning to drive", "rerun": "the viewer", "pyarrow": "Parquet"}

Finding = tuple[str, Literal["works", "missing", "fails"], str]
"""A part, its state, where `"missing"` is what can be done without, and what there is, or what to do about it."""


@dataclass(frozen=True)
class Doctor:
    """Say what is installed, what of this machine is used, what does not work, and what to do about it.

    Exit code 1 if something fails that is needed; cameras and boards that are not there do not count.
    """

    prepare: bool = False
    """Compile all kernels now, so that no first start waits for them: for images of small computers."""
    json: bool = False
    """Print the findings as one JSON object."""

    def run(self) -> int:
        findings = []
        for part, state, words in examine():
            findings.append({"part": part, "state": state, "words": words})
            if not self.json:
                print(f"{MARKS[state]} {part:24s} {words}", flush=True)
        seconds = {}
        for name, prepare in preparations() if self.prepare else ():
            began = time.perf_counter()
            prepare()
            seconds[name] = round(time.perf_counter() - began, 3)
            print(f"{seconds[name]:8.1f} s  {name}", file=sys.stderr if self.json else sys.stdout, flush=True)
        failed = [finding["part"] for finding in findings if finding["state"] == "fails"]
        if self.json:
            print(json.dumps({"findings": findings, "prepared_s": seconds, "failed": failed}))
        elif failed:
            print(f"does not work: {', '.join(failed)}")
        return 1 if failed else 0


def examine() -> Iterator[Finding]:
    from packaging.requirements import Requirement
    from packaging.specifiers import SpecifierSet

    from ndtorch.utils.packages import NAMES, OURS

    wanted: dict[str, SpecifierSet] = {}
    for ours in OURS:
        with contextlib.suppress(PackageNotFoundError):
            asked = [Requirement(text) for text in requires(ours) or ()]
            wanted |= {one.name: one.specifier for one in asked if one.specifier}
    yield "Python", "works", f"{platform.python_version()} on {platform.platform()}"
    for module in (*NEEDED, *OPTIONAL):
        name = NAMES.get(top := module.split(".")[0], top)
        try:
            loaded = import_module(module) if module in NEEDED else None
            there = str(getattr(loaded, "__version__", "") or version(name))
            if name in wanted and not wanted[name].contains(there, prereleases=True):
                advice = f"{wanted[name]} is asked for: pip install '{name}{wanted[name]}'"
                yield name, "fails", f"{there} ({getattr(loaded, '__file__', 'not loaded')}), but {advice}"
            else:
                yield name, "works", there
        except (ImportError, OSError, PackageNotFoundError) as error:
            why = f"for {OPTIONAL[module]}" if module in OPTIONAL else str(error).splitlines()[0]
            yield name, "missing" if module in OPTIONAL else "fails", f"not installed ({why}): pip install {name}"
    for check in (processor, kernels, cameras, serial_ports):
        try:
            yield from check()
        except Exception as error:  # whatever is wrong with this machine, the rest is still shown
            yield check.__name__, "fails", f"{type(error).__name__}: {error}"


def processor() -> Iterator[Finding]:
    import torch

    from ndtorch.utils.workers import cores

    units, threads = torch.backends.cpu.get_cpu_capability(), torch.get_num_threads()
    yield "processor", "works", f"{platform.machine()}, {cores()} cores, {units}, {threads} threads"
    yield "GPU", "works", torch.cuda.get_device_name(0) if torch.cuda.is_available() else "none"


def kernels() -> Iterator[Finding]:
    from ndtorch.utils.jit import cache_folder, make_private

    folder = cache_folder()
    if folder is None or not make_private(folder):
        advice = "give the folder to this user alone (chmod 700), or set XDG_CACHE_HOME to another one"
        yield "kernel cache", "fails", f"{folder} cannot be used, all is compiled at each start: {advice}"
    else:
        yield "kernel cache", "works", f"{folder}, {len(list(folder.rglob('*.nbc')))} functions; --prepare makes all"


def cameras() -> Iterator[Finding]:
    from ndtorch.errors import InputError
    from ndtorch_robot.cameras.source import CameraSettings, find_source, list_devices, open_capture

    devices = list_devices()
    if len(devices) < 2:
        yield "cameras", "missing", f"the kernel knows {len(devices)}, two are needed: plug both in (lsusb -t)"
    for device in devices:
        words = f"{device.name}, {device.by_path or 'without a name by path'}"
        try:
            settings = CameraSettings(left=device.node, right=device.node)
            open_capture(find_source(device.node), settings).release()
            yield device.node, "works", words
        except InputError as error:
            yield device.node, "fails", f"{words}: {error}"


def serial_ports() -> Iterator[Finding]:
    from serial.tools.list_ports import comports

    ports = comports()
    if not ports:
        yield "serial port", "missing", "none: plug the board in, dmesg says under which name it came"
    for port in ports:
        usable = os.access(port.device, os.R_OK | os.W_OK)
        advice = "" if usable else ": sudo usermod -aG dialout $USER, and log in again"
        yield port.device, "works" if usable else "missing", f"{port.description}{advice}"


def preparations() -> Iterator[tuple[str, Callable[[], object]]]:
    import torch

    import ndtorch
    from ndtorch.navigation import Grid, StereoRig, controller_names
    from ndtorch.navigation.options import NavigatorOptions

    torch.set_num_threads(1)
    for name in controller_names():
        for stereo in ("features", "search"):
            options = NavigatorOptions(name, stereo=stereo, localise=stereo == "search")
            navigator = options.navigator(StereoRig(), 30.0, Grid(-5.0, 5.0, -5.0, 5.0))
            yield f"{name}, {stereo}", navigator.warm_up
    frames = torch.zeros(12, 3, 48, 64, dtype=torch.uint8)
    for n, frame in enumerate(frames):
        frame[:, 16:32, 4 * n : 4 * n + 16] = 200
    for name in ndtorch.model_names():
        yield name, partial(ndtorch.load(name, size=(48, 64)), frames)
