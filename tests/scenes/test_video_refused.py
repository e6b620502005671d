"""Sources that cannot be read, and files that are not what they say, get one line."""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.scenes import VideoWriter, open_video
from ndtorch.scenes.readers import check_pixels
from tests.scenes.clips import SIZE, write


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    return write(tmp_path / "clip.mkv")


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("none.mp4", "does not exist"),
        ("empty.mp4", "empty"),
        ("noise.mp4", "cannot be opened"),
        ("text.txt", "text"),
        ("headless.mp4", "cannot be opened"),
        ("folder", "holds no images"),
        ("broken", "cannot be read"),
        ("/dev/null", "cannot be opened"),
        (97, "camera 97 cannot be opened"),
        ("camera:97", "camera 97 cannot be opened"),
        ("camera:x", "camera:0"),
        (-1, ">= 0"),
        ("http://127.0.0.1:9/clip.mp4", "cannot be opened"),
    ],
)
def test_sources_that_cannot_be_opened(tmp_path: Path, source: str | int, words: str) -> None:
    (tmp_path / "empty.mp4").touch()
    (tmp_path / "noise.mp4").write_bytes(bytes(range(256)) * 20)
    (tmp_path / "text.txt").write_text("words\n" * 100)
    (tmp_path / "folder").mkdir()
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "1.png").write_bytes(b"no image")
    whole = write(tmp_path / "whole.mp4").read_bytes()
    (tmp_path / "headless.mp4").write_bytes(whole[len(whole) // 2 :])
    plain = isinstance(source, int) or ":" in source or source.startswith("/")
    with pytest.raises(InputError, match=words) as caught:
        open_video(source if plain else tmp_path / str(source))
    assert "\n" not in str(caught.value)


def test_a_broken_image_later_in_the_folder_is_named(tmp_path: Path) -> None:
    image = np.random.default_rng(0).integers(0, 255, (30, 30, 3), np.uint8)
    cv2.imwrite(str(tmp_path / "1.png"), image)
    (tmp_path / "2.png").write_bytes((tmp_path / "1.png").read_bytes()[:60])
    video = open_video(tmp_path, (30, 30))
    with pytest.raises(InputError, match=r"2\.png"):
        list(video.chunks())


LISTS = {
    "ffconcat": "ffconcat version 1.0\nfile '{clip}'\n",
    "m3u8": "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{clip}\n#EXT-X-ENDLIST\n",
    "mpd": '<?xml version="1.0"?><MPD><BaseURL>{clip}</BaseURL></MPD>',
}


@pytest.mark.parametrize("kind", LISTS)
@pytest.mark.parametrize("tail", [b"", b"\n#\x00\xff"])
def test_a_list_of_other_files_is_no_video(tmp_path, kind, tail):
    with VideoWriter(tmp_path / "clip.avi", 25, SIZE) as video:
        for _ in range(3):
            video.write(torch.rand(3, *SIZE))
    path = tmp_path / "list.mp4"
    path.write_bytes(LISTS[kind].format(clip=tmp_path / "clip.avi").encode() + tail)
    with pytest.raises(InputError, match="it is text, or a list of other files"):
        open_video(path)


def png(width, height):
    """The beginning of a PNG that claims a size."""
    data = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = [data, b"IDAT" + zlib.compress(bytes(64))]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk)) for chunk in chunks
    )


@pytest.mark.parametrize(("width", "height"), [(65000, 65000), (100_000, 1), (9000, 9000)])
def test_an_image_that_claims_to_be_huge_is_not_decoded(tmp_path, width, height):
    (tmp_path / "1.png").write_bytes(png(width, height))
    with pytest.raises(InputError, match=r"cannot be used: .*pixels") as error:
        open_video(tmp_path)
    assert "\n" not in str(error.value)


def test_the_limits_of_pictures_can_be_set(tmp_path, monkeypatch):
    (tmp_path / "1.png").write_bytes(png(300, 20))
    check_pixels("it", 20, 300)
    monkeypatch.setenv("NDTORCH_LONGEST_SIDE", "299")
    with pytest.raises(InputError, match=r"300 x 20 pixels, .* 299 a side are the most .*NDTORCH_LONGEST_SIDE"):
        open_video(tmp_path)
    monkeypatch.setenv("NDTORCH_LONGEST_SIDE", "70000")
    monkeypatch.setenv("NDTORCH_MOST_PIXELS", "100000000")
    check_pixels("it", 9000, 9000)
    check_pixels("it", 1, 65000)
    for bad in ("0", "-5", "1e6", "many", "134217729"):
        monkeypatch.setenv("NDTORCH_MOST_PIXELS", bad)
        with pytest.raises(InputError, match="NDTORCH_MOST_PIXELS must be a number of pixels from 1 to 134217728"):
            open_video(tmp_path)


@pytest.mark.parametrize("name", ["clip.avi", "clip.mkv"])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_a_video_that_promises_what_is_cut_off_is_told(tmp_path, name, share):
    """The header of a film is written again at its end: a disk that was full meanwhile leaves a good one."""
    video = VideoWriter(tmp_path / name, 25, SIZE)
    for _ in range(20):
        video.write(torch.rand(3, *SIZE))
    video._writer.close()
    os.truncate(tmp_path / name, int(share * (tmp_path / name).stat().st_size))
    with pytest.raises(InputError, match="not whole: the disk may be full"):
        video.close()
