"""The published step in C99: equal to Python's over a drive, on this computer, a simulated Cortex-M4 and an AVR."""

import ctypes
import json
import shutil
import subprocess

import numpy as np
import pytest
import torch

from ndtorch.navigation import Grid, GridMap, Navigator, StereoRig
from ndtorch.navigation.stereo.strips import Strips
from ndtorch_robot.onboard import onboard_params
from ndtorch_robot.ports import DriveCommand
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.simulation import Simulation
from tests.robot.support.board_needed import FIRMWARE, needs_board

RIG = StereoRig(forward=0.15)
DT = 1 / 30
SOURCES = FIRMWARE / "onboard"
GRID = Grid(-1.0, 2.2, -1.6, 1.6, cell=0.05)
"""That of the map in cortex_m4.c."""

RANGE = np.dtype(
    [(name, "f4") for name in ("range", "left_angle", "right_angle", "x", "y")] + [("valid", "?"), ("", "V3")]
)
BEFORE = [("speed", "f4"), ("curvature", "f4"), ("sides", "f4", 2), ("mode", "u1"), ("", "V3")]
OUTPUT = np.dtype([*BEFORE, ("pose", "f4", 3), ("ranges", RANGE, 5)])
"""`onboard_output`."""

needs_arm = pytest.mark.skipif(
    not (shutil.which("arm-none-eabi-gcc") and shutil.which("qemu-system-arm")),
    reason="needs gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm (Debian packages)",
)


class View(ctypes.Structure):
    """`onboard_view`."""

    _fields_ = [("patch", ctypes.c_void_p), ("stride", ctypes.c_uint16), ("row", ctypes.c_void_p)]


def grey(pixels):
    return pixels.float().mean(-3, keepdim=True).round().to(torch.uint8)


@pytest.fixture(scope="module")
def drive():
    """Grey strips of a drive through a room, `[T, 2]` of patch and row, and Python's outputs."""
    navigator = Navigator(RIG, DT, controller="published", grid_map=GridMap(RIG, GRID, farthest=2.2))
    simulation = Simulation(load_arena("loop", 3), 3, rig=RIG, fields=navigator.controller.fields)
    simulation.place(3.0, 1.1, 0.5)
    frames, outputs, state = [], np.zeros(240, OUTPUT), None
    for out in outputs:
        seen = simulation.read()
        cut = [Strips(*(grey(part) for part in camera)) for camera in (seen.left, seen.right)]
        frames.append([(part.field.numpy().ravel(), part.row.numpy().ravel()) for part in cut])
        command, state = navigator(*cut, state)
        out["speed"], out["curvature"] = float(command.speed), float(command.curvature)
        out["sides"], out["mode"], out["pose"] = state.sides, navigator.mode(state), state.pose
        for name in ("x", "y", "left_angle", "right_angle", "valid"):
            out["ranges"][name] = getattr(state.ranges, name)
        out["ranges"]["range"] = state.ranges.left_range
        simulation.obey(DriveCommand(out["speed"], out["curvature"]))
        simulation.wait_until(simulation.now() + DT)
    simulation.close()
    assert outputs["ranges"]["valid"].sum() > 20
    assert len(set(outputs["mode"])) >= 3
    return frames, outputs, GRID.inner(state.map.cells).numpy()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where `params.h` lies."""
    folder = tmp_path_factory.mktemp("onboard")
    (folder / "params.h").write_text(onboard_params(RIG, DT, GRID.cell))
    return folder


def same(ours, outputs, within):
    """Asserts the commands; the share of frames with the same ranges, in which whole numbers may tie other features."""
    for name in ("speed", "curvature", "sides", "pose"):
        assert np.abs(ours[name] - outputs[name]).max() <= within, name
    assert (ours["mode"] == outputs["mode"]).all()
    agree = (ours["ranges"]["valid"] == outputs["ranges"]["valid"]).all(1)
    for name in RANGE.names[:5]:
        agree &= (np.abs(ours["ranges"][name] - outputs["ranges"][name]) <= within).all(1)
    return agree.mean()


@pytest.mark.compiled
@pytest.mark.parametrize("fixed", [False, True])
def test_equal_to_python(drive, folder, fixed):
    frames, outputs, _cells = drive
    library = folder / f"onboard{fixed}.so"
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-ffp-contract=off", "-shared", "-fPIC"]
    flags += ["-DONBOARD_FIXED"] if fixed else []
    subprocess.run(["cc", *flags, f"-I{folder}", "-o", library, SOURCES / "onboard.c", "-lm"], check=True)
    step = ctypes.CDLL(str(library)).onboard_step
    state, ours = ctypes.create_string_buffer(1 << 20), np.zeros(len(frames), OUTPUT)
    for n, frame in enumerate(frames):
        views = (View * 2)(*(View(field.ctypes.data, 85, row.ctypes.data) for field, row in frame))
        step(state, views, ours[n:].ctypes.data_as(ctypes.c_void_p))
    assert same(ours, outputs, 1e-3) >= (0.98 if fixed else 1)


@needs_arm
@pytest.mark.parametrize("kind", ["float", "fixed"])
def test_on_a_cortex_m4(drive, folder, kind):
    """Equal to Python, within a million instructions and 32 kB a step."""
    frames, outputs, cells = drive
    pixels = [
        np.concatenate([strip for part in (0, 1) for strip in (frame[0][part], frame[1][part])]) for frame in frames
    ]
    np.concatenate(pixels).tofile(folder / "drive.bin")
    make = ["make", "-s", "-C", SOURCES, f"OUT={folder}", f"PARAMS={folder}", f"KIND={kind}"]
    subprocess.run([*make, "m4"], check=True)
    done = subprocess.run([*make, "run"], check=True, capture_output=True, text=True, timeout=120)
    ours = np.fromfile(folder / "outputs.bin", OUTPUT)
    assert same(ours, outputs, 1e-3) >= (0.98 if kind == "fixed" else 1)
    if kind == "float":
        certainty = np.fromfile(folder / "map.bin", "f4").reshape(64, 64)
        assert np.abs(certainty - cells).max() <= 1e-3 * cells.max()
    cost = json.loads(done.stdout)
    assert cost["step_most"] + cost["map_most"] <= 1_000_000
    assert cost["state"] + cost["stack"] <= 32 * 1024


@needs_board
def test_avoidance_on_the_board_of_the_car(folder):
    """The same commands as on this computer, in 2 kB; at 16 MHz it keeps up with 30 frames a second."""
    small = (
        onboard_params(RIG, DT)
        .replace("PATCH_ROWS 29", "PATCH_ROWS 12")
        .replace("PATCH_COLUMNS 85", "PATCH_COLUMNS 16")
    )
    (folder / "small").mkdir()
    (folder / "small" / "params.h").write_text(small)
    subprocess.run(["make", "-s", "-C", SOURCES, f"OUT={folder}", f"PARAMS={folder / 'small'}", "avr"], check=True)
    subprocess.run(["make", "-s", "-C", FIRMWARE, "build/on_board"], check=True)
    board = [FIRMWARE / "build" / "on_board", folder / "avr.elf", folder / "board", "atmega328p"]
    subprocess.run(board, check=True, capture_output=True)
    here = subprocess.run([folder / "avr.here"], check=True, capture_output=True, text=True).stdout.splitlines()
    there = (folder / "board").read_text().splitlines()
    assert here[:-1] == there[:-1]
    assert {line.split()[1] for line in here[:-1]} == {"-1000", "0", "1000"}
    cycles, used = (int(word) for word in there[-1].split() if word.isdigit())
    assert cycles < 16e6 / 30
    assert used < 1600
