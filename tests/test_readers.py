"""Damaged files: whatever reads a file or a config reads what was written, or refuses it in one line."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from functools import cache
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import ndtorch
from ndtorch.binding.saving import load_state, save_state
from ndtorch.errors import InputError
from ndtorch.navigation import load_map
from ndtorch.utils.files import save_arrays
from ndtorch.utils.toml import read_toml
from ndtorch_robot.commands.drive import DriveArena
from ndtorch_robot.link.messages import Parser
from ndtorch_robot.run_config import RunConfig

SIZE = (24, 32)
SOME = settings(
    max_examples=25, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck)
)


@cache
def model() -> Any:
    return ndtorch.load("published", size=(16, 20), fps=100.0)


def write_state(path: Path) -> None:
    save_state(model()(torch.rand(4, 3, 16, 20))[1], path, {"run": "{}"})


def write_map(path: Path) -> None:
    cells = np.zeros((4, 5), np.float32)
    save_arrays(path, {"cells": cells, "bounds": np.array([-1.0, 1.5, -1.0, 1.0]), "cell": np.array(0.5)})


def write_film(path: Path) -> None:
    film = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, SIZE[::-1])
    for n in range(4):
        film.write(np.full((*SIZE, 3), 40 * n, np.uint8))
    film.release()


def read_film(path: Path) -> Any:
    from ndtorch.scenes.video import open_video

    with open_video(path, SIZE) as source:
        return sum(len(frames) for frames in islice(source.chunks(4), 6))


def read_barn(path: Path) -> Any:
    from ndtorch_robot.barn import read_worlds

    file = read_worlds(path)
    return [file.plan(world) for world in file.worlds]


BARN = {
    "start": [0.0, 0.0, 90.0],
    "goal": [0.0, 3.0],
    "radius_m": 0.075,
    "height_m": 1.0,
    "goal_radius_m": 1.0,
    "time_limit_s": 15.0,
    "worlds": [{"world": 5, "path_m": 12.0, "cylinders": [[0.3, 4.0], [-0.9, 5.0]]}],
}
KINDS: dict[str, tuple[str, Callable[[Path], Any], Callable[[Path], Any]]] = {
    "state": ("state.safetensors", write_state, lambda path: load_state(path, model())),
    "map": ("map.npz", write_map, load_map),
    "film": ("film.avi", write_film, read_film),
    "robot": (
        "robot.toml",
        lambda path: path.write_text(
            'board_name = "a"\n[body]\nlength_m = 0.5\n[link]\ndevice = "x"\n[cameras]\nleft = "a"\nright = "b"\n'
        ),
        lambda path: read_toml(path, RunConfig),
    ),
    "drive": (
        "drive.toml",
        lambda path: path.write_text('arena = "hallway"\nseed = 3\nseconds = 20.0\n'),
        lambda path: DriveArena(config=path).from_files(),
    ),
    "barn": ("worlds.json", lambda path: path.write_text(json.dumps(BARN, indent=1)), read_barn),
}
"""Name of a file, what writes it and what reads it."""


@cache
def whole(kind: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, KINDS[kind][0])
        KINDS[kind][1](path)
        KINDS[kind][2](path)
        return path.read_bytes()


@st.composite
def damaged(draw: st.DrawFn, data: bytes) -> bytes:
    """Some bytes changed, cut out, or put in; of texts also other values, deep nests and long numbers."""
    at = draw(st.integers(0, len(data) - 1))
    texts = [b"nan", b"-1", b"1e400", b"true", b'"', b"[" * 4000, b"9" * 5000, b"\xff\xfe", b"\0"]
    part = draw(st.one_of(st.binary(max_size=4), st.sampled_from(texts)))
    return data[:at] + part + data[at + draw(st.integers(0, 6)) :]


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("kind", KINDS)
@SOME
@given(choice=st.data())
def test_damaged_files_are_refused_in_one_line_or_read(kind: str, choice: st.DataObject) -> None:
    name, _, read = KINDS[kind]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, name)
        path.write_bytes(choice.draw(damaged(whole(kind))))
        refused = ""
        try:
            read(path)
        except InputError as error:
            refused = str(error)
    assert "\n" not in refused


@SOME
@given(data=st.binary(max_size=300), cuts=st.lists(st.integers(0, 300), max_size=4))
def test_bytes_of_a_drive_link_give_the_same_in_any_chunks(data: bytes, cuts: list[int]) -> None:
    parser, marks = Parser(), [0, *sorted(cuts), 300]
    frames = [frame for a, b in pairwise(marks) for frame in parser.feed(data[a:b])]
    assert frames == Parser().feed(data)
