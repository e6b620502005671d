"""Cameras and streams: every frame passes once, and its time is that at which it came."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

from ndtorch.errors import InputError
from ndtorch.scenes.addresses import FORMATS, check_scheme, redirected
from ndtorch.scenes.readers import Frame, Reader, check_pixels, open_capture, quiet_opencv
from ndtorch.scenes.stamps import rate_of
from ndtorch.scenes.video_file import decoded, pixels, stamp_of

SILENCE_S = 10.0
"""Seconds without a frame after which a stream has ended."""
FIRST_FRAMES, FIRST_S = 30, 1.5
"""The rate of a source without stamps is measured over so many frames, or so many seconds."""
SLOWER = 0.8
"""A camera that gives less than this share of the rate it claims runs at what it gives."""
ARRIVAL = ("mpjpeg", "mjpeg", "h264", "hevc", "image2pipe", "jpeg_pipe", "m4v")
"""Formats whose frames carry no time: they are taken as they arrive."""


class LiveReader(Reader):
    """A camera or a stream, held open.

    Attributes:
        ended: why no more frames came, once that is so.
    """

    live = True
    count = ticks = None
    ended = ""
    what: str

    def begin(self, declared: float, stamped: bool) -> None:
        """Take the first frames, which show the rate."""
        self._first, began = list[Frame](), time.monotonic()
        self._frames = self.arriving()
        for frame in self._frames:
            self._first.append(frame)
            if len(self._first) >= FIRST_FRAMES or time.monotonic() - began > FIRST_S:
                break
        if not self._first:
            self.close()
            raise InputError(f"{self.what} opens but delivers no frames{self.ended and ': ' + self.ended}")
        self.size = (self._first[0].image.shape[0], self._first[0].image.shape[1])
        check_pixels(self.what, *self.size)
        measured = rate_of([frame.stamp for frame in self._first], [declared] if declared else [])
        trusted = declared > 0 and not stamped and measured >= SLOWER * declared
        self.fps = declared if trusted or len(self._first) < 3 else measured
        if not trusted and measured and declared and abs(measured - declared) > 0.1 * declared:
            rates = f"declares {declared:g} frames a second and gives {measured:.3g}"
            self.notes = [f"{self.what} {rates}; --fps changes that"]

    def arriving(self) -> Iterator[Frame]:
        """Frames as they come."""
        raise NotImplementedError

    def read(self) -> Iterator[Frame]:
        while self._first:
            yield self._first.pop(0)
        yield from self._frames


class CameraReader(LiveReader):
    """A camera of this machine, by OpenCV.

    Args:
        source: its number, or the path of its device.
    """

    def __init__(self, source: int | str) -> None:
        import cv2

        self.what = f"camera {source}" if isinstance(source, int) else str(source)
        with quiet_opencv():
            self._capture: Any = open_capture(source)
        if self._capture is None:
            raise InputError(f"{self.what} cannot be opened: not there, in use, or no permission")
        declared = float(self._capture.get(cv2.CAP_PROP_FPS))
        self.begin(declared if 0 < declared < 1e9 else 0.0, stamped=False)

    def arriving(self) -> Iterator[Frame]:
        began = time.monotonic()
        while True:
            there, image = self._capture.read()
            if not there:
                self.ended = "it gives no more frames"
                return
            yield Frame(image, time.monotonic() - began)

    def close(self) -> None:
        self._first.clear()
        self._capture.release()


def open_stream(address: str) -> Any:
    """The open container of an address, or why there is none."""
    import av

    options = {"max_redirects": "0", "format_whitelist": FORMATS, "rtsp_transport": "tcp"}
    try:
        return av.open(address, options=options, timeout=(SILENCE_S, SILENCE_S))
    except (av.FFmpegError, OSError, ValueError) as error:
        words = (getattr(error, "strerror", None) or str(error)).strip()
        return words[:1].lower() + words[1:]


class StreamReader(LiveReader):
    """An address, by PyAV.

    Args:
        address: with "://".
        follow_redirects: also to other hosts.

    Raises:
        InputError: an address that does not answer, or whose answer is no film but a list of others.
    """

    def __init__(self, address: str, follow_redirects: bool = False) -> None:
        self.what = address
        check_scheme(address)
        opened = open_stream(address)
        if isinstance(opened, str) and (to := redirected(address, follow_redirects)) != address:
            opened = open_stream(to)
        if isinstance(opened, str):
            raise InputError(f"{address} cannot be opened: {opened} (not there, no permission, or a list of others)")
        self._container: Any = opened
        if not self._container.streams.video:
            self._container.close()
            raise InputError(f"{address} holds no video")
        stream = self._stream = self._container.streams.video[0]
        stream.thread_type = "AUTO"
        self._stamped = self._container.format.name not in ARRIVAL
        declared = float(stream.guessed_rate or 0)
        # Of a format without time stamps FFmpeg says 25, whatever comes.
        self.begin(declared if self._stamped else 0.0, self._stamped)

    def arriving(self) -> Iterator[Frame]:
        began = last = time.monotonic()
        for frame in decoded(self._container, self._stream):
            last = time.monotonic()
            stamp = stamp_of(frame) if self._stamped else last - began
            yield Frame(pixels(frame), stamp if stamp == stamp else last - began)
        silent = time.monotonic() - last
        self.ended = f"it sent nothing for {silent:.0f} s" if silent > 0.8 * SILENCE_S else "the sender ended it"

    def close(self) -> None:
        self._first.clear()
        self._container.close()
