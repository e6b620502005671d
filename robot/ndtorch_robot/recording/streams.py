"""What a recording is made of: its records and topics, and images and steps as messages and back."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, cast
from zlib import crc32

import numpy as np
import torch
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.navigation import Strips
from ndtorch_robot.ports import DriveCommand, Placed, Step

VERSION = 3

HEADER, END = "ndtorch", "ndtorch end"
"""Names of the metadata records at both ends of a recording."""

STEP = "/ndtorch/step"
"""Topic of what replay needs beside the images."""


def part_path(path: Path, number: int) -> Path:
    """Of a part of a recording, counted from 1: `NAME.mcap`, `NAME-2.mcap` and so on."""
    return path if number == 1 else path.with_name(f"{path.stem}-{number}{path.suffix}")


def image_topic(name: str) -> str:
    """Of an image such as `"left/field"`."""
    return f"/camera/{name}"


def crc_of(text: str) -> str:
    return f"{crc32(text.encode()):08x}"


def images_of(left: Tensor | Strips, right: Tensor | Strips) -> dict[str, Tensor]:
    """The images of a step by name: whole frames, or the strips of both cameras."""
    found: dict[str, Tensor] = {}
    for side, frame in (("left", left), ("right", right)):
        if isinstance(frame, Strips):
            found |= {f"{side}/field": frame.field, f"{side}/row": frame.row}
        else:
            found[f"{side}/image"] = frame
    for name, image in found.items():
        if image.dtype != torch.uint8 or image.ndim != 4 or image.shape[:2] not in ((1, 1), (1, 3)):
            raise InputError(
                f"only single uint8 frames [1, C, H, W] with C = 1 or 3 are recorded, "
                f"got {image.dtype} {tuple(image.shape)} of {name}"
            )
    return found


def frames_of(found: dict[str, Tensor]) -> tuple[Tensor | Strips, Tensor | Strips]:
    """The opposite of `images_of`; raises `KeyError` where one is missing."""
    if "left/image" in found:
        return found["left/image"], found["right/image"]
    left, right = (Strips(found[f"{side}/field"], found[f"{side}/row"]) for side in ("left", "right"))
    return left, right


def jpeg(image: Tensor) -> bytes:
    """An image `[1, C, H, W]` as a small file to look at."""
    import cv2

    array = np.ascontiguousarray(image[0].permute(1, 2, 0).numpy())
    array = cv2.cvtColor(array, cv2.COLOR_RGB2BGR) if array.shape[2] == 3 else array
    done, data = cv2.imencode(".jpg", array, [cv2.IMWRITE_JPEG_QUALITY, 85])
    assert done
    return data.tobytes()


def line_of(step: Step) -> dict[str, Any]:
    """All of a step but images and state, for JSON, in which numbers come back to the bit."""
    kept = step._asdict()
    del kept["frames"], kept["state"]
    taken = None if step.frames is None else step.frames.time
    return kept | {"taken": taken, "telemetry": dict(step.telemetry)}


def step_of(text: str) -> tuple[Step, float, list[str]]:
    """A step without its frames, when these were taken, and the names of its images."""
    values = json.loads(text)
    driven, wanted, sent = (DriveCommand(*numbers(values[key], 2)) for key in ("driven", "wanted", "sent"))
    placed: Placed = None
    if values["placed"] is not None:
        placed = cast("Placed", tuple(numbers(values["placed"], 3)))
    standing, telemetry = values["standing"], dict(values["telemetry"])
    if not isinstance(standing, str | None):
        raise TypeError("standing must be text")
    time, taken = numbers([values["time"], values["time"] if values["taken"] is None else values["taken"]], 2)
    number, used, restarted = int(values["number"]), bool(values["used"]), bool(values["restarted"])
    step = Step(number, time, None, driven, wanted, sent, None, standing, used, restarted, placed, telemetry)
    return step, taken, list(map(str, values["images"]))


def numbers(values: Any, count: int) -> list[float]:
    """So many finite numbers. Raises `ValueError`: other ones, or other things."""
    found = [float(value) for value in values if isinstance(value, int | float)]
    if len(found) != count or len(values) != count or not all(map(math.isfinite, found)):
        raise ValueError(f"expected {count} numbers, got {values}")
    return found
