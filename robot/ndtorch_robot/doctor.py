"""What of this machine the package uses, what does not work, and what to do about it."""

from __future__ import annotations

import os
import platform
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Literal, NamedTuple

from ndtorch.errors import InputError
from ndtorch.utils.jit import jit
from ndtorch.utils.packages import NAMES, remedy

NEEDED = ("torch", "numpy", "numba", "scipy", "cv2", "av", "serial", "mcap", "rosbags.typesys")
"""Modules without which something that is always promised does not work; they are loaded."""

OPTIONAL = {"mujoco": "simulated cars", "gymnasium": "learning to drive", "rerun": "the viewer", "pyarrow": "Parquet"}

FEATURES = ("avx", "avx2", "fma", "avx512f", "asimd", "sve")
"""Vector units that change how fast kernels are; the names are those of the Linux kernel."""

RENDER = """
import mujoco
model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
with mujoco.Renderer(model, 24, 32) as renderer:
    renderer.update_scene(data)
    assert renderer.render().any()
"""
"""Run in a process of its own: a wrong OpenGL library ends the process that loads it."""

PATIENCE_S = 60.0
"""Seconds in which a picture must be drawn."""


class Finding(NamedTuple):
    """What was found of one part.

    Attributes:
        part: of the package.
        state: whether it works; `"missing"` is what can be done without.
        words: what was found.
        advice: what to do; empty where there is nothing to do.
    """

    part: str
    state: Literal["works", "missing", "fails"]
    words: str
    advice: str = ""


@jit
def answer(a: float, b: float) -> float:
    """A kernel to try the compiler with."""
    return a * b


def examine() -> Iterator[Finding]:
    """All findings, the necessary ones first."""
    from importlib.metadata import PackageNotFoundError, version

    yield Finding("Python", "works", f"{platform.python_version()} on {platform.platform()}")
    for module in ("ndtorch", *NEEDED):
        top = module.split(".")[0]
        name = NAMES.get(top, top)
        try:
            import_module(module)
            yield Finding(name, "works", version(name))
        except (ImportError, OSError, PackageNotFoundError) as error:
            advice = remedy(top) or f"pip install {name}"
            yield Finding(name, "fails", f"cannot be loaded ({str(error).splitlines()[0]})", advice)
    for module, what in OPTIONAL.items():
        name = NAMES.get(module, module)
        try:
            yield Finding(name, "works", version(name))
        except PackageNotFoundError:
            yield Finding(name, "missing", f"not installed, for {what}", remedy(module) or f"pip install {name}")
    for check in (processor, kernels, cameras, opengl, serial_ports):
        try:
            yield from check()
        except Exception as error:  # whatever is wrong with this machine, the rest is still told
            yield Finding(check.__name__, "fails", f"{type(error).__name__}: {error}")


def processor() -> Iterator[Finding]:
    import torch

    listed = Path("/proc/cpuinfo")
    text = listed.read_text(errors="replace") if listed.is_file() else ""
    units = ", ".join(name for name in FEATURES if name in text.split()) or "no vector units known"
    named = re.search(r"^model name\s*: (.+)$", text, re.MULTILINE)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    yield Finding(
        "processor",
        "works",
        f"{platform.machine()} {named[1] if named else platform.processor()}, {cores} cores, {units}",
    )
    gpu = f", {torch.cuda.get_device_name(0)}" if torch.cuda.is_available() else ""
    yield Finding(
        "torch", "works", f"{torch.backends.cpu.get_cpu_capability()}, {torch.get_num_threads()} threads{gpu}"
    )


def kernels() -> Iterator[Finding]:
    from ndtorch.navigation.controllers.registry import controller_class, controller_names
    from ndtorch.utils.cache_folder import cache_folder

    began = time.perf_counter()
    right = answer(6.0, 7.0) == 42.0
    took = time.perf_counter() - began
    state: Literal["works", "fails"] = "works" if right else "fails"
    yield Finding("compiler", state, f"a kernel in {took:.2f} s", "" if right else "reinstall numba")
    if answer.folder is None:
        advice = "give the folder to this user alone (chmod 700), or set XDG_CACHE_HOME to another one"
        yield Finding(
            "kernel cache", "fails", f"{cache_folder()} cannot be used: all is compiled at each start", advice
        )
    else:
        kept = len(list(answer.folder.parent.rglob("*.nbc")))
        advice = "" if kept > 50 else "ndtorch doctor --prepare compiles all kernels now instead of at the first start"
        yield Finding("kernel cache", "works", f"{answer.folder.parent}, {kept} functions", advice)
    backends = ", ".join(f"{name} {controller_class(name).backend}" for name in controller_names())
    yield Finding("controllers", "works", backends)


def cameras() -> Iterator[Finding]:
    from ndtorch_robot.cameras import CameraSettings, find_source, list_devices
    from ndtorch_robot.cameras.pair import probe_size

    devices = list_devices()
    if len(devices) < 2:
        yield Finding(
            "cameras", "missing", f"the kernel knows {len(devices)}, two are needed", "plug both in: lsusb -t"
        )
    for device in devices:
        try:
            settings = CameraSettings(left=device.node, right=device.node)
            width, height = probe_size(find_source(device.node), settings)
            yield Finding(device.node, "works", f"{device.name}, {width}x{height}")
        except InputError as error:
            yield Finding(device.node, "fails", f"{device.name}: {error}", "ndtorch cameras lists what is there")


def opengl() -> Iterator[Finding]:
    advice = "MUJOCO_GL=egl with libegl1, or MUJOCO_GL=osmesa with libosmesa6; only worlds with curved bodies need it"
    command = [sys.executable, "-c", RENDER]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
        works, said = done.returncode == 0, (done.stderr.strip().splitlines() or [f"ended with {done.returncode}"])[-1]
    except subprocess.TimeoutExpired:
        works, said = False, f"no picture in {PATIENCE_S:.0f} s"
    used = os.environ.get("MUJOCO_GL", "default")
    found = f"MUJOCO_GL={used} draws" if works else f"MUJOCO_GL={used}: {said}"
    yield Finding("OpenGL", "works" if works else "missing", found, "" if works else advice)


def serial_ports() -> Iterator[Finding]:
    from serial.tools.list_ports import comports

    ports = comports()
    if not ports:
        yield Finding("serial port", "missing", "none", "plug the board in; dmesg says under which name it came")
    for port in ports:
        usable = os.access(port.device, os.R_OK | os.W_OK)
        advice = "" if usable else "sudo usermod -aG dialout $USER, and log in again"
        words = f"{port.description}" if usable else f"{port.description}: this user may not use it"
        yield Finding(port.device, "works" if usable else "missing", words, advice)


def preparations() -> Iterator[tuple[str, Callable[[], object]]]:
    """What compiles all kernels, by name."""
    import torch

    import ndtorch
    from ndtorch.navigation import Grid, StereoRig, controller_names
    from ndtorch.navigation.options import NavigatorOptions
    from ndtorch_robot.navigator_runner import NavigatorRunner

    rig, grid = StereoRig(), Grid(-5.0, 5.0, -5.0, 5.0)
    for name in controller_names():
        for stereo in ("features", "search"):
            options = NavigatorOptions(name, stereo=stereo, localise=stereo == "search")
            yield f"{name}, {stereo}", NavigatorRunner(options, rig, 30.0, grid).warm_up
    frames = torch.zeros(12, 3, 48, 64, dtype=torch.uint8)
    for n, frame in enumerate(frames):
        frame[:, 16:32, 4 * n : 4 * n + 16] = 200
    for name in ndtorch.model_names():
        yield name, lambda name=name: ndtorch.load(name, size=(48, 64))(frames)  # type: ignore[misc]
