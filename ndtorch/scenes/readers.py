"""Readers of video files, folders of images, cameras and streams: decoded frames with time stamps."""

from __future__ import annotations

import contextlib
import math
import os
import re
import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from configparser import ConfigParser
from configparser import Error as ConfigParserError
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ndtorch.errors import InputError
from ndtorch.utils.files import read_bytes, read_text, readable

MOST_PIXELS, LONGEST = 2**26, 2**15
"""Pixels of the largest picture that is decoded, and of its longest side: a small file may claim any size."""
PACKETS = 20_000
"""Number of packets whose time stamps give the rate of a file."""
RAW_FPS, FOLDER_FPS, BELIEVED, FASTEST = 25.0, 30.0, 240.0, 10_000.0
"""Rates of films without time stamps and of folders; the largest declared rate that counts without time stamps, and at
all, Hz."""
SILENCE_S = 10.0
"""Seconds without a frame after which a stream has ended."""
FIRST_FRAMES, FIRST_S = 30, 1.5
"""Frames, or seconds, over which the rate of a camera is measured."""
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm")
VIDEO_SUFFIXES = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".ts", ".mts", ".wmv", ".h264")
LISTS = (b"ffconcat", b"#EXTM3U", b"<?xml", b"<MPD", b"[playlist]", b"[reference]", b"v=0")
"""First bytes of files that make FFmpeg open others: a video is one file, and opens none."""
SCHEMES = ("http", "https", "rtsp", "rtsps", "rtmp", "rtmps", "rtp", "udp", "srt", "tcp")
FORMATS = (
    "mov,mp4,matroska,webm,avi,mpegts,mpeg,mpegvideo,flv,asf,ogg,mpjpeg,mjpeg,jpeg_pipe,h264,hevc,av1,obu,ivf,m4v,gif,"
    "mxf,nut,yuv4mpegpipe,rtsp,rtp"
)
"""Formats of an address that hold pictures themselves. Playlists (HLS, DASH, concat) name further addresses."""
ARRIVAL = ("mpjpeg", "mjpeg", "h264", "hevc", "image2pipe", "jpeg_pipe", "m4v")
"""Formats without time stamps: frames get the time at which they arrive."""
DEPTH_AND_COLOR, UNCHANGED = 2 | 4, -1
"""`cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR`: depth and channels as they are, turned upright, no transparency; and
`cv2.IMREAD_UNCHANGED`, with it."""

Image = np.ndarray[Any, np.dtype[Any]]
"""`[H, W, 3]` in blue, green, red, or `[H, W]` in grey; uint8, or what the file has where it has more."""


class StampedFrame(NamedTuple):
    """A decoded frame and its time stamp in seconds, on the clock of the source."""

    image: Image
    stamp: float


class Stretch(NamedTuple):
    """Values `low` to `high` of deep images are shown as 0 to 255."""

    low: float
    high: float

    def __call__(self, image: Image) -> Image:
        scaled = (np.nan_to_num(image.astype(np.float32), nan=self.low) - self.low) * (255 / (self.high - self.low))
        levels: Image = np.clip(scaled + 0.5, 0, 255).astype(np.uint8)
        return levels

    def __str__(self) -> str:
        return f"values {self.low:.6g} to {self.high:.6g} are shown as 0 to 255"


class Reader(ABC):
    """A source of decoded frames.

    Attributes:
        fps: rate of the frames by their time stamps, else as the source declares it; may be nonsense.
        stamps: time stamps of all frames where they are known beforehand.
        count: number of frames, or None where it is not known before the last one.
        live: whether frames pass only once.
        timed: whether time stamps say when a frame is to be seen; False takes frames as they follow.
        size: height and width of a frame.
        names: file names of the frames, of a folder.
        notes: remarks on the source, a line each.
        stretch: of images of more than eight bits.
        ended: why a live source delivers no more frames.
        damaged: number of frames, in the last reading, that could not be decoded, or only in part.
    """

    fps: float
    count: int | None = None
    live = False
    timed = False
    size: tuple[int, int]
    stamps: Sequence[float] = ()
    names: Sequence[str] | None = None
    notes: Sequence[str] = ()
    stretch: Stretch | None = None
    ended = ""
    damaged = 0

    @abstractmethod
    def read(self) -> Iterator[StampedFrame]:
        """Frames from the first on, until no more can be decoded. A live source goes on where it is."""

    def close(self) -> None:  # noqa: B027  nothing to do for most
        """Close the device, if any is open."""


class FileReader(Reader):
    """A video file, read with PyAV. Every reading opens it anew, so several may go on side by side."""

    def __init__(self, path: Path) -> None:
        check_file(path)
        self.path = path
        container, stream = open_file(path)
        with container:
            check_pixels(f"video {path}", stream.codec_context.height, stream.codec_context.width)
            declared = [float(rate) for rate in (stream.guessed_rate, stream.average_rate) if rate]
            framerate = stream.codec_context.framerate
            stamps, whole = packet_stamps(container, stream)
            others, index = sum(not attached(one) for one in container.streams.video) - 1, stream.index
            self.count = len(stamps) if whole and stamps else int(stream.frames) or None
        self.timed = len(stamps) > 1
        self.fps = rate_of(stamps, declared) if self.timed else RAW_FPS
        if self.timed:
            self.stamps = stamps if whole else ()
        elif self.count != 1:
            believed = framerate and float(framerate) <= BELIEVED
            self.fps = float(framerate) if believed else RAW_FPS
            source = "as it declares" if believed else "assumed"
            self.notes = [
                f"video {path.name} has no time stamps: {self.fps:g} frames a second, {source}; --fps changes that"
            ]
        if others:
            self.notes = [
                *self.notes,
                f"video {path.name} has {others + 1} video streams: number {index + 1} is read",
            ]
        first = next(self.read(), None)
        if first is None:
            raise InputError(f"video {path} cannot be used: none of its frames can be decoded")
        self.size = (first.image.shape[0], first.image.shape[1])

    def read(self) -> Iterator[StampedFrame]:
        container, stream = open_file(self.path)
        self.damaged = 0
        with container:
            stream.thread_type = "AUTO"
            last = -1 / (self.fps or RAW_FPS)
            for frame in decoded(container, stream):
                self.damaged += frame is None or frame.is_corrupt
                if frame is None:
                    continue
                stamp = stamp_of(frame)
                last = last + 1 / (self.fps or RAW_FPS) if math.isnan(stamp) else stamp
                yield StampedFrame(pixels(frame), last)


class ImagesReader(Reader):
    """The images of a folder in natural order (2.png before 10.png), or of a sequence of MOTChallenge.

    Hidden files are left out. Names that are decimal numbers are times in seconds; otherwise a constant rate is
    assumed, and noted, where no seqinfo.ini says it. What is transparent shows a plain grey ground.
    """

    def __init__(self, path: Path) -> None:
        folder, rate = mot_sequence(path)
        self.path, self.fps, self.transparent = path, rate or FOLDER_FPS, False
        self.files, self.notes = image_files(folder)
        self.stamps = times_in(self.files)
        self.count, self.names = len(self.files), [readable(file.name) for file in self.files]
        whole = read_image(self.files[0], UNCHANGED)
        self.transparent = whole is not None and whole.ndim == 3 and whole.shape[2] == 4
        first = self.image(0)
        self.size, self.stretch = (first.shape[0], first.shape[1]), find_stretch(first)
        words = "by seqinfo.ini" if rate else "at an assumed"
        if self.stamps:
            self.timed, self.fps, words = True, rate_of(self.stamps, ()), "by their names"
        self.notes.append(f"{path.name}: {self.count} images {words} {self.fps:g} a second; --fps changes that")

    def image(self, number: int) -> Image:
        """The image of that number, upright, what is transparent over grey; grey stays `[H, W]`, depth stays.

        Raises:
            InputError: an image that cannot be decoded, or is of another size than the first.
        """
        path = self.files[number]
        image = read_image(path, UNCHANGED if self.transparent else DEPTH_AND_COLOR)
        if image is not None and image.ndim == 3 and image.shape[2] == 4:
            ground = 0.5 if image.dtype.kind == "f" else 127.5 if image.dtype == np.uint8 else 32767.5
            opaque = image[..., 3:] / (2.0 * ground)
            image = (image[..., :3] * opaque + ground * (1 - opaque)).astype(image.dtype)
        if image is None:
            raise InputError(f"image {path} cannot be read: damaged, too large or not an image")
        if number and image.shape[:2] != self.size:
            (height, width), (own_height, own_width) = self.size, image.shape[:2]
            raise InputError(
                f"images must have one size: the first is {width} x {height} pixels, "
                f"{path.name} {own_width} x {own_height}"
            )
        return image

    def read(self) -> Iterator[StampedFrame]:
        for number in range(self.count or 0):
            yield StampedFrame(self.image(number), self.stamps[number] if self.stamps else number / self.fps)


class LiveReader(Reader):
    """A camera of this machine by OpenCV, or an address by PyAV; held open.

    Raises:
        InputError: nothing answers, no frame comes, or the answer of an address is no film but a list of others.
    """

    live = True

    def __init__(self, source: int | str) -> None:
        address = isinstance(source, str) and "://" in source
        self.what = source if isinstance(source, str) else f"camera {source}"
        self._frames = self._from_address(str(source)) if address else self._from_camera(source)
        began, self._first = math.inf, list[StampedFrame]()
        for frame in self._frames:  # it is opened as the first frame is read
            began = min(began, time.monotonic())
            self._first.append(frame)
            if len(self._first) >= FIRST_FRAMES or time.monotonic() - began > FIRST_S:
                break
        if not self._first:
            self.close()
            raise InputError(f"{self.what} opens but delivers no frames{self.ended and ': ' + self.ended}")
        self.size = (self._first[0].image.shape[0], self._first[0].image.shape[1])
        check_pixels(self.what, *self.size)
        declared, stamps = self._declared, [frame.stamp for frame in self._first]
        measured = rate_of(stamps, [declared] if declared else [])
        # A camera whose frames were waiting is not faster than it says.
        self.fps = declared if declared and (measured >= 0.8 * declared or len(self._first) < 3) else measured

    def _from_camera(self, source: int | str) -> Iterator[StampedFrame]:
        import cv2

        self._device: Any = open_capture(source)
        if self._device is None:
            raise InputError(f"{self.what} cannot be opened: not there, in use, or no permission")
        declared = float(self._device.get(cv2.CAP_PROP_FPS))
        self._declared = declared if 0 < declared < 1e9 else 0.0
        began = time.monotonic()
        while True:
            there, image = self._device.read()
            if not there:
                self.ended = "it gives no more frames"
                return
            yield StampedFrame(image, time.monotonic() - began)

    def _from_address(self, address: str) -> Iterator[StampedFrame]:
        import av

        check_scheme(address)
        options = {"max_redirects": "0", "format_whitelist": FORMATS, "rtsp_transport": "tcp"}
        try:
            self._device = av.open(address, options=options, timeout=(SILENCE_S, SILENCE_S))
        except (av.FFmpegError, OSError, ValueError) as error:
            words = (getattr(error, "strerror", None) or str(error)).strip()
            causes = "not there, no permission, a redirect, or a list of others"
            raise InputError(f"{address} cannot be opened: {words[:1].lower() + words[1:]} ({causes})") from None
        if not self._device.streams.video:
            self._device.close()
            raise InputError(f"{address} holds no video")
        stream = film_of(self._device)
        stream.thread_type = "AUTO"
        stamped = self._device.format.name not in ARRIVAL
        # Of a format without time stamps FFmpeg says 25, whatever comes.
        self._declared = float(stream.guessed_rate or 0) if stamped else 0.0
        began = last = time.monotonic()
        for frame in decoded(self._device, stream):
            if frame is None:
                continue
            last = time.monotonic()
            stamp = stamp_of(frame) if stamped else math.nan
            yield StampedFrame(pixels(frame), last - began if math.isnan(stamp) else stamp)
        silent = time.monotonic() - last
        self.ended = f"it sent nothing for {silent:.0f} s" if silent > 0.8 * SILENCE_S else "the sender ended it"

    def read(self) -> Iterator[StampedFrame]:
        while self._first:
            yield self._first.pop(0)
        yield from self._frames

    def close(self) -> None:
        self._first.clear()
        self._device.close() if hasattr(self._device, "close") else self._device.release()


@contextlib.contextmanager
def quiet_opencv() -> Iterator[None]:
    """Keep the messages of OpenCV, 5 and later, off stderr: an `InputError` says what went wrong.

    FFmpeg inside OpenCV takes its level from the environment once, as the first video is opened.
    """
    import cv2

    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    logger = getattr(cv2.utils, "logging", None)
    if logger is None:
        yield
        return
    level = logger.getLogLevel()
    logger.setLogLevel(logger.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        logger.setLogLevel(level)


def read_image(path: Path, flags: int) -> Image | None:
    """An image file as `cv2.imread` reads it, of any name, or None. Raises `InputError`: no regular file."""
    import cv2

    data = np.frombuffer(read_bytes(path), np.uint8)
    image: Any = None
    with quiet_opencv(), contextlib.suppress(cv2.error):
        image = cv2.imdecode(data, flags)
    return None if image is None else np.asarray(image)


def open_capture(source: int | str) -> Any:
    """An open `cv2.VideoCapture` of a camera, file or address, or None. FFmpeg opens nothing besides."""
    import cv2

    address = isinstance(source, str) and "://" in source
    if address:
        check_scheme(str(source))
    allowed = f"max_redirects;0|format_whitelist;{FORMATS}" if address else "protocol_whitelist;file,pipe,fd"
    variable = "OPENCV_FFMPEG_CAPTURE_OPTIONS"
    before = os.environ.get(variable)
    os.environ[variable] = f"{before or 'rtsp_flags;prefer_tcp'}|{allowed}"
    try:
        with quiet_opencv():
            capture = cv2.VideoCapture(source, cv2.CAP_FFMPEG) if address else cv2.VideoCapture(source)
    except cv2.error:
        return None
    finally:
        os.environ.pop(variable) if before is None else os.environ.update({variable: before})
    return capture if capture.isOpened() else None


def check_scheme(address: str) -> None:
    """Raise `InputError` for an address whose scheme is not one of `SCHEMES`."""
    scheme = address.partition("://")[0].lower()
    if scheme not in SCHEMES:
        raise InputError(f"source cannot be an address that begins with {scheme}://; there are {', '.join(SCHEMES)}")


def check_pixels(what: str, height: int, width: int) -> None:
    """Raise `InputError` for pictures of more pixels, or of a longer side, than the limits allow."""
    if height * width > MOST_PIXELS or max(height, width) > LONGEST:
        raise InputError(
            f"{what} cannot be used: {width} x {height} pixels; at most {MOST_PIXELS} in all and {LONGEST} a side"
        )


def check_file(path: Path) -> None:
    """Raise `InputError`, with the reason, for a file that is no video at its first bytes."""
    if not path.is_file():
        raise InputError(f"video {path} cannot be opened: it is no regular file")
    try:
        with path.open("rb") as file:
            head = file.read(4096)
    except OSError as error:
        raise InputError(f"video {path} cannot be opened: {error.strerror}") from None
    if not head:
        raise InputError(f"video {path} is empty (0 bytes)")
    printable = all(byte >= 32 or byte in b"\t\n\r\f\x1b" for byte in head[:512])
    # The last letter may be cut.
    text = printable and "\ufffd" not in head.decode(errors="replace")[:-1] and not head.startswith(b"YUV4MPEG2")
    if text or head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(LISTS):
        raise InputError(f"video {path} cannot be used: it is text, or a list of other files")


def open_file(path: Path) -> tuple[Any, Any]:
    """An open container and its video stream."""
    import av

    # A name with a colon, as 12:30.mp4, is an address to FFmpeg unless it is told that it is a file.
    try:
        container = av.open(f"file:{path.absolute()}", options={"protocol_whitelist": "file"})
    except (av.FFmpegError, OSError, ValueError) as error:
        words = (getattr(error, "strerror", None) or str(error)).strip()
        cause = "not a video, damaged, or cut off before its index was written"
        raise InputError(f"video {path} cannot be opened: {words[:1].lower() + words[1:]} ({cause})") from None
    stream = film_of(container)
    if stream is not None:
        return container, stream
    container.close()
    raise InputError(f"video {path} cannot be used: it holds no film that can be decoded")


def film_of(container: Any) -> Any:
    """The video stream with the largest pictures, a film before the picture of a cover; None where there is none."""
    streams = [stream for stream in container.streams.video if stream.codec_context is not None]
    return max(streams, key=lambda stream: (not attached(stream), stream.width * stream.height), default=None)


def attached(stream: Any) -> bool:
    """Whether a stream is a picture that belongs to a file: a cover."""
    import av

    return bool(stream.disposition & av.stream.Disposition.attached_pic)


def packet_stamps(container: Any, stream: Any) -> tuple[list[float], bool]:
    """Time stamps of a film in the order in which its frames are shown, and whether these are all."""
    import av

    stamps = list[float]()
    with contextlib.suppress(av.FFmpegError, OSError):
        for packet in container.demux(stream):
            at = packet.pts if packet.pts is not None else packet.dts
            if packet.size and not packet.is_discard and at is not None:
                stamps.append(float(at * packet.time_base))
            if len(stamps) >= PACKETS:
                return in_order(stamps), False
    return in_order(stamps), True


def in_order(stamps: list[float]) -> list[float]:
    """Stamps of packets, which are in the order of decoding, sorted between jumps back of more than a second."""
    parts, part = list[float](), list[float]()
    for stamp in stamps:
        if part and stamp < max(part[-32:]) - 1:
            parts += sorted(part)
            part = []
        part.append(stamp)
    return parts + sorted(part)


def decoded(container: Any, stream: Any) -> Iterator[Any]:
    """Every frame that can be decoded, and None for each packet that cannot."""
    import av

    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets)
        except (StopIteration, av.FFmpegError, OSError):
            return
        try:
            yield from packet.decode()
        except (av.FFmpegError, OSError):
            yield None


def stamp_of(frame: Any) -> float:
    """Seconds of a frame by its time stamp, NaN without one."""
    at = frame.pts if frame.pts is not None else frame.dts
    return math.nan if at is None or frame.time_base is None else float(at * frame.time_base)


def pixels(frame: Any) -> Image:
    """A decoded frame, turned upright as its file says: blue, green and red."""
    image: Image = frame.to_ndarray(format="bgr24")
    turns = round(frame.rotation / 90) % 4
    return np.ascontiguousarray(np.rot90(image, turns)) if turns else image


def image_files(folder: Path) -> tuple[list[Path], list[str]]:
    """The images of a folder in natural order, one a name, without hidden files, and remarks.

    Raises:
        InputError: it holds none.
    """
    files = [path for path in folder.iterdir() if not path.name.startswith(".")]
    images = [path for path in files if path.suffix.lower() in IMAGE_SUFFIXES and not path.is_dir()]
    if not images:
        films = sorted(path.name for path in files if path.suffix.lower() in VIDEO_SUFFIXES)
        inner = sorted(path.name for path in files if path.is_dir())
        hint = f"; it holds {'videos' if films else 'folders'}: name one of them, as {(films or inner or [''])[0]}"
        hint = hint if films or inner else ""
        raise InputError(f"folder {folder} holds no images ({', '.join(IMAGE_SUFFIXES)}){hint}")
    kinds = Counter(path.suffix.lower() for path in images)
    images.sort(key=lambda path: (-kinds[path.suffix.lower()], IMAGE_SUFFIXES.index(path.suffix.lower())))
    chosen = {path.stem: path for path in reversed(images)}
    notes = []
    if len(chosen) < len(images):
        rest = len(images) - len(chosen)
        notes = [f"{folder.name}: {rest} images left out beside others of their names, which are {images[0].suffix}"]

    def natural(path: Path) -> list[tuple[int, str]]:
        return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", path.name.lower())]

    found = sorted(chosen.values(), key=natural)
    by_time = sorted(found, key=lambda path: float(path.stem)) if all(map(DECIMAL.fullmatch, chosen)) else []
    return by_time if times_in(by_time) else found, notes


DECIMAL = re.compile(r"\d{1,12}(\.\d{1,12})?")


def times_in(files: Sequence[Path]) -> list[float]:
    """Times in seconds that are the names of images, in this order: increasing decimal numbers. Nothing for others."""
    names = [file.stem for file in files]
    if not any("." in name for name in names) or not all(map(DECIMAL.fullmatch, names)):
        return []
    times = [float(name) for name in names]
    return times if all(before < after for before, after in pairwise(times)) else []


def mot_sequence(folder: Path) -> tuple[Path, float | None]:
    """The images of a sequence of MOTChallenge, and its rate by seqinfo.ini; another folder as it is, and None."""
    for parent in (folder, folder.resolve().parent):
        parser = ConfigParser(interpolation=None)
        with contextlib.suppress(OSError, ValueError, LookupError, ConfigParserError):
            parser.read_string(read_text(parent / "seqinfo.ini"))
            table = parser["Sequence"]
            rate, images = float(table["frameRate"]), parent / Path(table.get("imDir", "img1")).name
            if images.is_dir() and 0 < rate <= FASTEST and folder.resolve() in (parent.resolve(), images.resolve()):
                return images, rate
    return folder, None


def rate_of(stamps: Sequence[float], declared: Iterable[float]) -> float:
    """Frames a second by time stamps: by the mean of the intervals near their median, or of all where frames arrive in
    bursts, some at once; 0 where there are too few.

    Args:
        stamps: in the order in which frames are shown, seconds.
        declared: rates that the container claims; one within 2 % is returned as it is, since stamps are rounded.

    >>> rate_of([0.0, 0.033, 0.067, 0.1], (1000.0, 29.97))
    29.97
    """
    steps = np.diff(np.asarray(stamps, dtype=np.float64))
    steps = steps[np.isfinite(steps) & (steps >= 0)]
    if not steps.any():
        return 0.0
    middle = float(np.median(steps))
    near = np.abs(steps - middle) <= max(0.25 * middle, 0.0011)
    # A pause is one long interval, bursts have many, which take most of the time.
    bursts = not steps[near].any() or (near.mean() < 0.97 and 2 * steps[near].sum() < steps.sum())
    rate = 1 / float((steps if bursts else steps[near]).mean())
    return next((one for one in declared if abs(one - rate) <= 0.02 * rate), rate)


def find_stretch(image: Image) -> Stretch | None:
    """The range of a deep image with a margin of half; None of an image of eight bits."""
    if image.dtype == np.uint8:
        return None
    values = image[np.isfinite(image)].astype(np.float64)
    low, high = np.quantile(values, (0.001, 0.999)) if values.size else (0.0, 1.0)
    middle, room = (low + high) / 2, max(1.5 * (high - low), 1e-6)
    return Stretch(float(middle - room / 2), float(middle + room / 2))
