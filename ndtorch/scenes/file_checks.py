"""What is checked before a file of frames is decoded: that it opens no others, and claims no absurd size."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

from ndtorch.errors import InputError

MOST_PIXELS = 2**26
"""Pixels of the largest picture that is decoded, 8192 x 8192: a file of some bytes may claim any size."""

LONGEST = 2**15
"""Pixels of the longest side of a picture."""

LIMITS = {"NDTORCH_MOST_PIXELS": (MOST_PIXELS, 2**27), "NDTORCH_LONGEST_SIDE": (LONGEST, 2**20)}
"""Variables of the environment that set other limits: their values where they are not set, and the most they may be."""

LISTS = (b"ffconcat", b"#EXTM3U", b"<?xml", b"<MPD", b"[playlist]", b"[reference]", b"v=0")
"""How files begin that make FFmpeg open others: a video is one file, and opens none."""


def is_text(path: Path) -> bool:
    """Whether a file is text, or begins as those do that name other files to be opened."""
    with path.open("rb") as file:
        head = file.read(4096)
    if head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(LISTS):
        return True
    return (
        not head.startswith(b"YUV4MPEG2")
        and all(byte >= 32 or byte in b"\t\n\r\f\x1b" for byte in head[:512])
        and (_decodes(head))
    )


def _decodes(head: bytes) -> bool:
    """Whether bytes are UTF-8, but for a letter that is cut at the end."""
    try:
        head.decode()
    except UnicodeDecodeError as error:
        return error.start >= len(head) - 3
    return True


def claimed_size(path: Path) -> tuple[int, int]:
    """Height and width of an image as its header has them; nothing is decoded.

    Raises:
        InputError: no image, or one so large that not even its header is believed.
    """
    from PIL import Image as Headers

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Headers.DecompressionBombWarning)  # `check_pixels` has the word on that
            with Headers.open(path) as image:
                return image.height, image.width
    except Headers.DecompressionBombError:
        raise InputError(
            f"image {path} cannot be used: it claims more than {limit('NDTORCH_MOST_PIXELS')} pixels"
        ) from None
    except Exception:
        raise InputError(f"image {path} cannot be read: empty, damaged or not an image") from None


def limit(name: str) -> int:
    """One of `LIMITS`, as the environment has it now.

    Raises:
        InputError: it is no number, or out of range.
    """
    usual, most = LIMITS[name]
    given = os.environ.get(name, "")
    if not given:
        return usual
    if not (given.isascii() and given.isdigit() and len(given) < 12 and 1 <= int(given) <= most):
        raise InputError(f"{name} must be a number of pixels from 1 to {most}, got {given!r}")
    return int(given)


def check_pixels(what: str, height: int, width: int) -> None:
    """Raise `InputError` for pictures of more pixels, or of a longer side, than the limits allow."""
    most, longest = limit("NDTORCH_MOST_PIXELS"), limit("NDTORCH_LONGEST_SIDE")
    if height * width > most or max(height, width) > longest:
        raise InputError(
            f"{what} cannot be used: {width} x {height} pixels, {most} in all and {longest} a side are the most "
            f"({' and '.join(LIMITS)} set other limits)"
        )
