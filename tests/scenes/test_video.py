"""Reading and writing video: round trips, parts and fits."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.scenes import VideoWriter, open_video
from tests.scenes.clips import SIZE, fake_capture, pattern, write


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    return write(tmp_path / "clip.mkv")


@pytest.mark.parametrize(("suffix", "most"), [(".mkv", 0), (".avi", 30), (".mp4", 40)])
def test_round_trip(tmp_path: Path, suffix: str, most: int) -> None:
    with open_video(write(tmp_path / f"clip{suffix}"), SIZE) as video:
        assert (video.name, video.fps, video.size, video.length) == ("clip", 25.0, SIZE, 20)
        chunks = list(video.chunks(8))
    assert [len(chunk) for chunk in chunks] == [8, 8, 4]
    frames = torch.cat(chunks)
    assert frames.dtype == torch.uint8
    want = torch.stack([pattern(n) for n in range(20)])
    # Away from the edges of the pattern, where the lossy codecs smear.
    inner = (frames.int() - want.int()).abs()[..., [8, 40], :][..., [8, 56]]
    assert inner.max() <= most


def test_start_and_stop_count_frames_of_the_source(clip: Path) -> None:
    video = open_video(clip, SIZE, start=5, stop=12)
    assert video.length == 7
    for start in (0, 3):
        frames = torch.cat(list(video.chunks(4, start=start)))
        assert frames[:, 0, 40, 56].tolist() == [10 * n for n in range(5 + start, 12)]
    assert list(video.chunks(4, start=7)) == []
    assert open_video(clip, SIZE, stop=3).length == 3
    assert open_video(clip, SIZE, start=19).length == 1


@pytest.mark.parametrize("size", [(48, 48), (100, 50), (31, 77)])
def test_crop_keeps_the_middle_and_stretch_keeps_all(clip: Path, size: tuple[int, int]) -> None:
    crop = next(iter(open_video(clip, size).chunks(1)))
    stretch = next(iter(open_video(clip, size, fit="stretch").chunks(1)))
    assert crop.shape == stretch.shape == (1, 3, *size)
    for frames in (crop, stretch):
        corners = frames[0, :, [2, 2, -3], [2, -3, 2]]
        assert torch.equal(corners > 100, torch.eye(3, dtype=torch.bool))
    # What is square stays square when cropped: the top left color fills half of the image either way.
    assert int((crop[0, 0, 2] > 100).sum()) == pytest.approx(size[1] / 2, abs=1)


def test_folder_in_natural_order(tmp_path: Path) -> None:
    for n in (10, 9, 1):
        cv2.imwrite(str(tmp_path / f"im{n}.png"), np.full((40, 60, 3), 10 * n, np.uint8))
    (tmp_path / "notes.txt").write_text("not an image")
    video = open_video(tmp_path, (20, 20))
    assert (video.length, video.fps, video.name) == (3, 30.0, tmp_path.name)
    frames = next(iter(video.chunks()))
    assert frames[:, 0, 5, 5].tolist() == [10, 90, 100]
    assert next(iter(open_video(str(tmp_path), (20, 20), start=1, fps=5).chunks()))[0, 0, 0, 0] == 90


@pytest.mark.parametrize(
    ("names", "order", "rate"),
    [
        (("0.1.png", "0.033.png", "0.067.png"), (1, 2, 0), 1 / 0.0335),
        (("1.1.png", "1.10.png", "2.1.png"), (0, 1, 2), 30.0),
        (("f0.jpg", "f0.png", "f1.png"), (1, 2), 30.0),
        (("seqinfo.ini", "img1/1.jpg", "img1/10.jpg", "img1/2.jpg"), (1, 3, 2), 14.0),
    ],
)
def test_folders_by_time_one_a_name_and_of_motchallenge(
    tmp_path: Path, names: tuple[str, ...], order: tuple[int, ...], rate: float
) -> None:
    (tmp_path / "img1").mkdir()
    for n, name in enumerate(names):
        if name.endswith(".ini"):
            (tmp_path / name).write_text("[Sequence]\nimDir=img1\nframeRate=14\n")
        else:
            cv2.imwrite(str(tmp_path / name), np.full((40, 60, 3), 20 * n, np.uint8))
    with open_video(tmp_path, (20, 20)) as video:
        assert next(iter(video.chunks()))[:, 0, 5, 5].tolist() == [20 * n for n in order]
        assert video.fps == pytest.approx(rate)


def test_what_is_transparent_shows_a_plain_ground(tmp_path: Path) -> None:
    image = np.zeros((40, 60, 4), np.uint8)
    image[:20] = (0, 0, 0, 255)
    cv2.imwrite(str(tmp_path / "0.png"), image)
    frame = next(iter(open_video(tmp_path, (40, 60)).chunks()))[0]
    assert frame[:, [5, 35], 30].tolist() == [[0, 127]] * 3


def test_grey_images_are_copied_into_three_planes_and_say_so(tmp_path: Path) -> None:
    for n in range(3):
        cv2.imwrite(str(tmp_path / f"{n}.png"), np.full((30, 30), 50 + n, np.uint8))
    video = open_video(tmp_path, (30, 30))
    with pytest.warns(UserWarning, match="is grey") as caught:
        frames = next(iter(video.chunks()))
    assert len(caught) == 1
    assert frames[:, :, 3, 3].tolist() == [[50 + n] * 3 for n in range(3)]


def test_a_camera_is_read_as_it_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    fake_capture(monkeypatch, fps=30, count=-1)
    with open_video("camera:0", SIZE) as video:
        assert (video.name, video.length, video.fps) == ("camera-0", None, 30)
        chunks = video.chunks(4)
        assert next(chunks)[:, 0, 0, 0].tolist() == [19, 18, 17, 16]
        assert next(video.chunks(2))[:, 0, 0, 0].tolist() == [15, 14]
        with pytest.raises(InputError, match="live"):
            video.chunks(4, start=3)
    with pytest.raises(InputError, match="closed"):
        video.chunks()
    part = open_video(0, SIZE, start=2, stop=5)
    assert part.length == 3
    assert torch.cat(list(part.chunks(8)))[:, 0, 0, 0].tolist() == [17, 16, 15]


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
