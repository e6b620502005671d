"""Frames as bytes: one file an image stream, each image written after the last."""

from __future__ import annotations

import json
from typing import Any, Literal
from zlib import crc32

import numpy as np
import torch
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.navigation import Strips

Format = Literal["png", "jpeg", "raw"]

SUFFIXES: dict[str, str] = {"png": "pngs", "jpeg": "mjpeg", "raw": "rgb"}
"""Suffix of a stream's file by format."""

JPEG_QUALITY = 95


def checked_line(line: dict[str, Any]) -> bytes:
    """A line of JSON that ends in `"crc"`: the CRC-32 of what stands before it."""
    text = json.dumps(line, separators=(",", ":")).encode()[:-1]
    return text + f',"crc":{crc32(text)}}}\n'.encode()


def is_intact(line: bytes) -> bool:
    text, mark, crc = line.rstrip(b"\n").rpartition(b',"crc":')
    return bool(mark) and crc == f"{crc32(text)}}}".encode()


def crc_of(values: dict[str, Any]) -> int:
    return crc32(json.dumps(values, sort_keys=True).encode())


def images_of(left: Tensor | Strips, right: Tensor | Strips) -> dict[str, Tensor]:
    """The images of a step by the name of their stream: whole frames, or the strips of both eyes.

    Raises:
        InputError: frames that are not one uint8 image each, grey or in color.
    """
    found: dict[str, Tensor] = {}
    for side, frame in (("left", left), ("right", right)):
        if isinstance(frame, Strips):
            found |= {f"{side}-field": frame.field, f"{side}-row": frame.row}
        else:
            found[side] = frame
    for name, image in found.items():
        if image.dtype != torch.uint8 or image.ndim != 4 or image.shape[:2] not in ((1, 1), (1, 3)):
            raise InputError(
                f"only single uint8 frames [1, C, H, W] with C = 1 or 3 are recorded, "
                f"got {image.dtype} {tuple(image.shape)} of {name}"
            )
    return found


def frames_of(found: dict[str, Tensor]) -> tuple[Tensor | Strips, Tensor | Strips]:
    if "left" in found:
        return found["left"], found["right"]
    return tuple(Strips(found[f"{side}-field"], found[f"{side}-row"]) for side in ("left", "right"))  # type: ignore[return-value]


def encode(frame: Tensor, kind: Format, quality: int = JPEG_QUALITY) -> bytes:
    """An image `[1, C, H, W]` as the bytes of a PNG or JPEG file, or as raw bytes row by row, red, green, blue."""
    import cv2

    image = np.ascontiguousarray(frame[0].permute(1, 2, 0).numpy())
    if kind == "raw":
        return image.tobytes()
    if image.shape[2] == 3:
        image = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    if kind == "png":
        # Fast and a tenth larger: recording must keep up with two cameras.
        done, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    else:
        done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert done
    return data.tobytes()


def decode(data: bytes, shape: tuple[int, int, int], kind: Format) -> Tensor | None:
    """The image `[1, C, H, W]` of `shape` (C, H, W) again; None where the bytes are none."""
    import cv2

    channels, height, width = shape
    if kind == "raw":
        if len(data) != channels * height * width:
            return None
        image: Any = np.frombuffer(data, np.uint8).reshape(height, width, channels).copy()
    else:
        flags = cv2.IMREAD_COLOR if channels == 3 else cv2.IMREAD_GRAYSCALE
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
        if image is None or image.shape[:2] != (height, width):
            return None
        image = cv2.cvtColor(image, cv2.COLOR_BGR2RGB) if channels == 3 else image[..., None]
    return torch.from_numpy(image).permute(2, 0, 1)[None]
