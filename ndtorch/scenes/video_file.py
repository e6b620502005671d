"""Video files, read with PyAV."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ndtorch.errors import InputError
from ndtorch.scenes.readers import Frame, Image, Reader, check_pixels, is_text
from ndtorch.scenes.stamps import rate_of, ticks_of

PACKETS = 20_000
"""Packets that are looked at for their time stamps before a film is decoded."""
RAW_FPS = 25.0
"""Rate of a film without time stamps that declares none either."""
BELIEVED = 240.0
"""Largest rate that is believed without time stamps: encoders leave 1000 there that were given none."""
SAMPLES = 12
"""Places of a film at which two frames are looked at before it is read."""
APPLE_DOUBLE = b"\x00\x05\x16\x07"
"""How the files begin in which macOS keeps what it knows about another file, `._NAME`."""
DEEP_GREY = {"gray9", "gray10", "gray12", "gray14", "gray16"}
"""Pixel formats, less the order of their bytes, of grey of more than eight bits."""


class FileReader(Reader):
    """A video file. Every reading opens it anew, so several may go on side by side.

    Attributes:
        promised: frames that its header says it has, 0 where it does not.
    """

    timed = True
    promised: int

    def __init__(self, path: Path) -> None:
        check_file(path)
        self.path = path
        container, stream = open_container(path)
        with container:
            codec = stream.codec_context
            check_pixels(f"video {path}", codec.height, codec.width)
            stamps, ended = packet_stamps(container, stream)
            self._declared = [float(rate) for rate in (stream.guessed_rate, stream.average_rate) if rate]
            self._duration = duration_of(container, stream)
            self._begin = float((stream.start_time or 0) * stream.time_base)
            promised = int(stream.frames)
        first = next(self.read(), None)
        if first is None:
            raise InputError(f"video {path} cannot be used: none of its frames can be decoded")
        self.size = (first.image.shape[0], first.image.shape[1])
        self.fps = rate_of(stamps, self._declared)
        self.timed = len(stamps) > 1
        self.count = len(stamps) if ended and stamps else promised or None
        self.promised, self.ticks = max(promised, self.count or 0), self.count
        if len(stamps) < 2:
            self._without_stamps(promised)
        elif ended:
            self.ticks = ticks_of(stamps, self.fps) if 0 < self.fps < math.inf else self.count
        elif self.count is None and self._duration is not None:
            self.ticks = round(self._duration * self.fps)
        if self._duration is not None and self.timed and self.is_short(0, stamps[-1]):
            # The header of a file that was cut off says how long it was.
            self.promised = max(self.promised, round(self._duration * self.fps))

    def _without_stamps(self, promised: int) -> None:
        """The rate of a file whose frames have no time stamps, and a line about it."""
        container, stream = open_container(self.path)
        with container:
            declared = stream.codec_context.framerate or (stream.average_rate if promised else None)
        declared = declared if declared and float(declared) <= BELIEVED else None
        self.fps = float(declared) if declared else RAW_FPS
        self.count = self.ticks = promised or None
        self.promised = promised
        if promised != 1:
            source = "as it declares" if declared else "assumed"
            self.notes = [
                f"video {self.path.name} has no time stamps: {self.fps:g} frames a second, {source}; --fps changes that"
            ]

    def read(self) -> Iterator[Frame]:
        container, stream = open_container(self.path)
        with container:
            stream.thread_type = "AUTO"
            last = math.nan
            for number, frame in enumerate(decoded(container, stream)):
                stamp = stamp_of(frame)
                if math.isnan(stamp):
                    fps = getattr(self, "fps", RAW_FPS) or RAW_FPS
                    stamp = number / fps if math.isnan(last) else last + 1 / fps
                last = stamp
                yield Frame(pixels(frame), stamp)

    def samples(self) -> list[tuple[Image, Image]]:
        """Two frames each at places all over the film, without decoding what is between them."""
        import av

        pairs: list[tuple[Image, Image]] = []
        container, stream = open_container(self.path)
        with container:
            span = 0.0 if self._duration is None or not self.timed else self._duration
            for place in range(SAMPLES):
                if span > 0:
                    try:
                        container.seek(round((self._begin + span * place / SAMPLES) / stream.time_base), stream=stream)
                    except (av.FFmpegError, OSError):
                        break
                images = [pixels(frame) for _, frame in zip(range(2), decoded(container, stream), strict=False)]
                if len(images) < 2:
                    break
                pairs.append((images[0], images[1]))
        return pairs

    def is_short(self, decoded: int, last: float) -> bool:
        if 0 < decoded < self.promised:
            return True
        if self._duration is None or not self.timed or self.fps <= 0:
            return False
        return last + 2.5 / self.fps < self._begin + 0.98 * self._duration


def check_file(path: Path) -> None:
    """Raise `InputError`, with the reason, for a file that is no video at its first bytes."""
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except PermissionError:
        raise InputError(f"video {path} cannot be read: no permission") from None
    except OSError as error:
        raise InputError(f"video {path} cannot be opened: {error.strerror}") from None
    if not head:
        raise InputError(f"video {path} is empty (0 bytes)" if path.is_file() else f"video {path} cannot be opened")
    if head.startswith(APPLE_DOUBLE):
        own = path.with_name(path.name.removeprefix("._"))
        raise InputError(f"video {path} cannot be used: it holds what macOS knows about {own.name}, not the film")
    if is_text(path):
        raise InputError(f"video {path} cannot be used: it is text, or a list of other files")


def open_container(path: Path) -> tuple[Any, Any]:
    """An open file and its video stream."""
    import av

    # A name with a colon, as 12:30.mp4, is an address to FFmpeg unless it is told that it is a file.
    try:
        container = av.open(f"file:{path.absolute()}", options={"protocol_whitelist": "file"})
    except (av.FFmpegError, OSError, ValueError) as error:
        words = (getattr(error, "strerror", None) or str(error)).strip()
        raise InputError(f"video {path} cannot be opened: {words[:1].lower() + words[1:]}{cause(path)}") from None
    streams = [one for one in container.streams.video if not int(one.disposition) & ATTACHED]
    if not streams:
        kinds = sorted({str(one.type) for one in container.streams}) or ["nothing"]
        container.close()
        raise InputError(f"video {path} cannot be used: it holds no film ({', '.join(kinds)} only)")
    stream: Any = streams[0]
    if stream.codec_context is None:
        container.close()
        raise InputError(f"video {path} cannot be used: there is no decoder for its codec")
    if stream.codec_context.name == "ansi":
        container.close()
        raise InputError(f"video {path} cannot be used: it is text")
    return container, stream


ATTACHED = 0x0400
"""Flag of a stream that is the cover of a piece of music (AV_DISPOSITION_ATTACHED_PIC)."""


def cause(path: Path) -> str:
    """Why a file may be damaged, where that can be seen: an MP4 file without its index."""
    with path.open("rb") as file:
        head = file.read(12)
        if head[4:8] != b"ftyp":
            return " (not a video, damaged or cut off at its start)"
        place, size = 0, path.stat().st_size
        while place + 8 <= size:
            file.seek(place)
            box = file.read(16)
            length, kind = int.from_bytes(box[:4], "big"), box[4:8]
            length = int.from_bytes(box[8:16], "big") if length == 1 else length
            if kind == b"moov" and place + length <= size:
                return " (damaged)"
            if length < 8:
                break
            place += length
    return " (its index, moov, is missing: the recording was not finished, or the file is cut off)"


def duration_of(container: Any, stream: Any) -> float | None:
    """Seconds by the header of a film, None where it does not say."""
    if stream.duration:
        return float(stream.duration * stream.time_base)
    return container.duration / 1e6 if container.duration and container.duration > 0 else None


def packet_stamps(container: Any, stream: Any) -> tuple[list[float], bool]:
    """Time stamps of a film in the order in which its frames are shown, and whether these are all."""
    import av

    stamps, ended = list[float](), True
    try:
        for packet in container.demux(stream):
            if packet.size == 0 or packet.is_discard:
                continue
            at = packet.pts if packet.pts is not None else packet.dts
            if at is not None:
                stamps.append(float(at * packet.time_base))
            if len(stamps) >= PACKETS:
                ended = False
                break
    except (av.FFmpegError, OSError):
        pass
    # Packets are in the order of decoding. Where a recording follows another one, each has its own order.
    return in_order(stamps), ended


def in_order(stamps: list[float]) -> list[float]:
    """Stamps of packets, sorted between jumps back of more than a second."""
    parts, part, latest = list[float](), list[float](), -math.inf
    for stamp in stamps:
        if stamp < latest - 1:
            parts += sorted(part)
            part, latest = [], -math.inf
        part.append(stamp)
        latest = max(latest, stamp)
    return parts + sorted(part)


def decoded(container: Any, stream: Any) -> Iterator[Any]:
    """Every frame that can be decoded; damaged packets are left out."""
    import av

    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets, None)
        except (av.FFmpegError, OSError):
            return
        if packet is None:
            return
        try:
            frames = packet.decode()
        except (av.FFmpegError, OSError):
            continue
        yield from frames


def stamp_of(frame: Any) -> float:
    """Seconds of a frame by its time stamp, NaN without one."""
    at = frame.pts if frame.pts is not None else frame.dts
    return math.nan if at is None or frame.time_base is None else float(at * frame.time_base)


def pixels(frame: Any) -> Image:
    """A decoded frame, turned upright as its file says: blue, green and red, or deep grey as it is."""
    name = frame.format.name.removesuffix("le").removesuffix("be")
    image: Image = frame.to_ndarray(format="gray16le" if name in DEEP_GREY else "bgr24")
    turns = round(frame.rotation / 90) % 4
    return np.ascontiguousarray(np.rot90(image, turns)) if turns else image
