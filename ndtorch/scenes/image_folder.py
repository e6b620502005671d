"""Folders of images, and images of several pages."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ndtorch.errors import InputError
from ndtorch.scenes.readers import Frame, Image, Reader, check_pixels, claimed_size, quiet_opencv

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm")
VIDEO_SUFFIXES = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".ts", ".mts", ".wmv", ".h264")
SYSTEM_FILES = ("thumbs.db", "ehthumbs.db", "desktop.ini")
"""Files that systems leave in folders of images, besides those whose name begins with a dot."""
FOLDER_FPS = 30.0
ASSUMED = f"{{}}: {{}} {{}} at an assumed {FOLDER_FPS:g} a second; --fps changes that"
SAMPLES = 12
"""Places at which two images are looked at before a folder is read."""
DEPTH_AND_COLOR = 2 | 4
"""`cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR`: depth and channels as they are, turned upright, no transparency."""


class ImagesReader(Reader):
    """Images one after the other, which have no time stamps: a constant rate is assumed, and said."""

    fps = FOLDER_FPS
    count: int

    def image(self, number: int) -> Image:
        """The image of that number."""
        raise NotImplementedError

    def label(self, number: int) -> str:
        """How it is called in messages."""
        raise NotImplementedError

    def read(self) -> Iterator[Frame]:
        for number in range(self.count):
            image = self.image(number)
            if image.shape[:2] != self.size:
                (height, width), (own_height, own_width) = self.size, image.shape[:2]
                raise InputError(
                    f"images of a folder must have one size: {self.label(0)} is {width} x {height} pixels, "
                    f"{self.label(number)} {own_width} x {own_height}"
                )
            yield Frame(image, number / self.fps)

    def samples(self) -> list[tuple[Image, Image]]:
        places = sorted({round(place) for place in np.linspace(0, max(0, self.count - 2), SAMPLES)})
        pairs = []
        for k in places:
            try:
                pairs.append((self.image(k), self.image(min(k + 1, self.count - 1))))
            except InputError:  # named when its turn comes
                continue
        return [pair for pair in pairs if pair[0].shape == pair[1].shape]


class FolderReader(ImagesReader):
    """The images of a folder in natural order: 2.png comes before 10.png. Hidden files are left out."""

    def __init__(self, folder: Path) -> None:
        import cv2

        found = [path for path in folder.iterdir() if not path.is_dir()]
        hidden = sorted(path.name for path in found if is_hidden(path))
        files = (path for path in found if path.suffix.lower() in IMAGE_SUFFIXES and not is_hidden(path))
        self.files = sorted(files, key=_natural)
        if not self.files:
            raise InputError(f"folder {folder} holds no images ({', '.join(IMAGE_SUFFIXES)}){instead(found, hidden)}")
        self.names = [path.name for path in self.files]
        self.count = self.ticks = len(self.files)
        self.notes = [ASSUMED.format(f"folder {folder.name}", self.count, "images")]
        if hidden:
            others = "file is" if len(hidden) == 1 else "files are"
            shown = ", ".join(hidden[:3]) + (", ..." if len(hidden) > 3 else "")
            self.notes.append(f"folder {folder.name}: {len(hidden)} hidden {others} left out ({shown})")
        with quiet_opencv():
            for path in self.files:
                if not path.is_file():
                    raise InputError(f"image {path} cannot be read: {reason(path)}")
                if not cv2.haveImageReader(str(path)):
                    raise InputError(f"image {path} cannot be read: {reason(path)}")
            first = read_image(self.files[0])
        self.size = (first.shape[0], first.shape[1])

    def image(self, number: int) -> Image:
        return read_image(self.files[number])

    def label(self, number: int) -> str:
        return str(self.files[number])


class PagesReader(ImagesReader):
    """The pages of one image file, as microscopes and thermal cameras write them (TIFF)."""

    def __init__(self, path: Path) -> None:
        import cv2

        self.path = path
        check_pixels(f"image {path}", *claimed_size(path))
        with quiet_opencv():
            self.count = self.ticks = cv2.imcount(str(path), DEPTH_AND_COLOR)
        if self.count < 2:
            raise InputError(f"{path} is one image: a video, a folder of images or a TIFF of several pages is needed")
        self.notes = [ASSUMED.format(f"image {path.name}", self.count, "pages")]
        first = self.image(0)
        self.size = (first.shape[0], first.shape[1])

    def image(self, number: int) -> Image:
        import cv2

        with quiet_opencv():
            try:
                found, pages = cv2.imreadmulti(str(self.path), number, 1, flags=DEPTH_AND_COLOR)
            except cv2.error:
                found = False
        if not found or not pages:
            raise InputError(f"image {self.path} cannot be read: page {number + 1} of {self.count} is damaged")
        image: Image = np.asarray(pages[0])
        return image

    def label(self, number: int) -> str:
        return f"{self.path}, page {number + 1},"


def is_hidden(path: Path) -> bool:
    """Whether a file is a system's own, no data: `.DS_Store`, `._1.jpg`, `Thumbs.db`."""
    return path.name.startswith(".") or path.name.lower() in SYSTEM_FILES


def instead(found: list[Path], hidden: list[str]) -> str:
    """What a folder without images holds, and what to do."""
    films = sorted(path.name for path in found if path.suffix.lower() in VIDEO_SUFFIXES and not is_hidden(path))
    if films:
        return f"; it holds {len(films)} video{'s' * (len(films) > 1)}: name one of them, as {films[0]}"
    if hidden:
        return f"; {len(hidden)} hidden files are left out, as {hidden[0]}"
    return ""


def reason(path: Path) -> str:
    """Why an image cannot be read."""
    if path.is_symlink() and not path.exists():
        return "it is a link to a file that is not there"
    if not path.is_file():
        return "it is no regular file"
    try:
        with path.open("rb") as file:
            head = file.read(1)
    except PermissionError:
        return "no permission"
    except OSError as error:
        return str(error.strerror)
    return "damaged or not an image" if head else "it is empty (0 bytes)"


def read_image(path: Path) -> Image:
    """An image turned upright as its file says, without transparency; grey stays `[H, W]`, depth stays what it is."""
    import cv2

    check_pixels(f"image {path}", *claimed_size(path))
    try:
        with quiet_opencv():
            image = cv2.imread(str(path), DEPTH_AND_COLOR)
    except cv2.error:
        image = None
    if image is None:
        raise InputError(f"image {path} cannot be read: {reason(path)}")
    return np.asarray(image)


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sort key in which runs of digits count as numbers."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name.lower())]
