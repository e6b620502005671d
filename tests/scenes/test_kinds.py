"""Files as people have them: rates that are claimed, gaps, depth, fields, odd names, hidden files, silent cameras."""

from __future__ import annotations

import http.server
import logging
import math
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from ndtorch.errors import InputError
from ndtorch.scenes import open_video, readers
from tests.scenes.clips import film, write

SIZE = (96, 160)


def picture(number: int) -> np.ndarray:
    """A square that moves by 8 pixels a frame over a still ground, `[H, W, 3]` uint8."""
    image = np.random.default_rng(1).integers(90, 110, (*SIZE, 3)).astype(np.uint8)
    left = 8 * number % (SIZE[1] - 40)
    image[30:60, left : left + 40] = (220, 40, 40)
    return image


def encode(path: Path, stamps: list[float], claim: int = 25, container: str | None = None) -> Path:
    return film(path, [picture(n) for n in range(len(stamps))], stamps, claim, container)


def read(video: object) -> int:
    return sum(len(chunk) for chunk in video.chunks())  # type: ignore[attr-defined]


def test_the_rate_is_that_of_the_stamps_not_the_claimed_one(tmp_path: Path) -> None:
    with open_video(encode(tmp_path / "claim.mkv", [n / 20 for n in range(40)], claim=1000), SIZE) as video:
        assert video.fps == pytest.approx(20)
        assert (read(video), video.length) == (40, 40)


@pytest.mark.parametrize("jump", [3600.0, 60.0, -2.0])
def test_a_jump_of_the_stamps_is_a_cut(tmp_path: Path, jump: float) -> None:
    first = [n / 25 for n in range(50)]
    for name, begin in (("a.ts", 10.0), ("b.ts", 12.0 + jump)):
        encode(tmp_path / name, [begin + stamp for stamp in first])
    (tmp_path / "gap.ts").write_bytes((tmp_path / "a.ts").read_bytes() + (tmp_path / "b.ts").read_bytes())
    with open_video(tmp_path / "gap.ts", SIZE) as video:
        assert video.fps == pytest.approx(25)
        with pytest.warns(UserWarning, match=r"frame 51 is .* (later|earlier) than the one before: treated as a cut"):
            assert read(video) == 100
        assert video.cuts == pytest.approx((2.0,))
        decoded = video.decoded
        assert decoded.tick.tolist() == list(range(100))
        assert decoded.stamp[50] - decoded.stamp[49] == pytest.approx(jump + 0.04, abs=0.01)


def test_notes_on_films_are_true(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Cut between two key frames, overwritten in the middle, and with a small still stream before the film."""
    path = encode(tmp_path / "film.mp4", [n / 25 for n in range(60)])
    with av.open(str(path)) as whole, av.open(str(tmp_path / "cut.mp4"), "w") as cut:
        stream = cut.add_stream_from_template(whole.streams.video[0])
        for packet in [packet for packet in whole.demux(video=0) if packet.size][10:]:
            packet.stream = stream
            cut.mux(packet)
    data = bytearray(path.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 2000] = b"\xff" * 2000
    (tmp_path / "damaged.mp4").write_bytes(data)
    for name, words in (("cut", "lacks frames at its start: 40 of 50"), ("damaged", r"is damaged: \d\d of 60 frames")):
        with open_video(tmp_path / f"{name}.mp4", SIZE) as video, pytest.warns(UserWarning, match=words):
            assert 20 < read(video) <= 60
    with av.open(str(tmp_path / "two.mkv"), "w") as file:
        streams = [file.add_stream("libx264", rate=25) for _ in range(2)]
        for stream, size in zip(streams, ((64, 80), SIZE), strict=True):
            stream.height, stream.width = size
        for stream in streams:
            size = stream.height, stream.width
            for n in range(10):
                file.mux(stream.encode(av.VideoFrame.from_ndarray(picture(n)[: size[0], : size[1]].copy(), "rgb24")))
            file.mux(stream.encode())
    with caplog.at_level(logging.INFO), open_video(tmp_path / "two.mkv", SIZE) as video:
        assert (video.full_size, read(video)) == (SIZE, 10)
    assert "2 video streams: number 2 is read" in caplog.text


def test_a_film_without_stamps_says_what_rate_is_assumed(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = encode(tmp_path / "raw.h264", [n / 25 for n in range(20)], container="h264")
    with caplog.at_level(logging.INFO), open_video(path, SIZE) as video:
        assert read(video) == 20
    assert "raw.h264 has no time stamps: 25 frames a second" in caplog.text
    assert "--fps changes that" in caplog.text


def thermal(number: int) -> np.ndarray:
    """8000 counts with noise of 3, and a patch of 250 more that moves."""
    image = 8000 + 3 * np.random.default_rng(number).standard_normal(SIZE)
    image[30:60, 4 * number : 4 * number + 30] += 250
    return image.astype(np.uint16)


@pytest.mark.parametrize("kind", ["png", "tiff"])
def test_more_than_eight_bits_are_stretched(tmp_path: Path, kind: str) -> None:
    images = [thermal(n) for n in range(12)]
    for n, image in enumerate(images):
        cv2.imwrite(str(tmp_path / f"{n}.{kind}"), image)
    with pytest.warns(UserWarning, match=r"more than eight bits: values \S+ to \S+ are shown as 0 to 255"):
        video = open_video(tmp_path, SIZE)
    with pytest.warns(UserWarning, match="is grey"):
        frames = next(iter(video.chunks(12)))
    assert len(frames) == 12
    ground, patch = frames[3, 0, 70:].double(), frames[3, 0, 32:58, 14:40].double()
    assert patch.mean() - ground.mean() > 100
    assert ground.std() < 4


@pytest.mark.parametrize("name", ["2024-05-01T12:30:00.mp4", "a b%d#?.mp4", "-x.mp4"])
def test_odd_names_are_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    write(tmp_path / "plain.mp4").rename(tmp_path / name)
    monkeypatch.chdir(tmp_path)
    assert read(open_video(name)) == 20


def test_reasons_are_the_reasons(tmp_path: Path) -> None:
    whole = write(tmp_path / "clip.mp4").read_bytes()
    (tmp_path / "cut.mp4").write_bytes(whole[:24] + b"\0\0\0\x08free" + bytes(200))
    cv2.imwrite(str(tmp_path / "one.tif"), picture(0))
    (tmp_path / "gone.mp4").symlink_to(tmp_path / "nowhere.mp4")
    (tmp_path / "films").mkdir()
    write(tmp_path / "films" / "a.mp4")
    for name, words in {
        "cut.mp4": "cut off before its index",
        "one.tif": "one image: a video or a folder of images",
        "gone.mp4": "link to a file that is not there",
        "films": r"holds videos: name one of them, as a\.mp4",
    }.items():
        with pytest.raises(InputError, match=words):
            open_video(tmp_path / name)


def test_hidden_files_are_left_out(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for n in range(3):
        cv2.imwrite(str(tmp_path / f"{n}.png"), picture(n))
        (tmp_path / f"._{n}.png").write_bytes(b"\0\5\x16\7" + bytes(60))
    (tmp_path / ".DS_Store").write_bytes(b"x")
    (tmp_path / "Thumbs.db").write_bytes(b"x")
    with caplog.at_level(logging.INFO), open_video(tmp_path, SIZE) as video:
        assert read(video) == 3
        assert list(video.decoded.names) == ["0.png", "1.png", "2.png"]
    assert "an assumed 30 a second" in caplog.text


def test_every_nth_frame_keeps_the_numbers_of_the_source(tmp_path: Path) -> None:
    with open_video(write(tmp_path / "clip.mp4"), SIZE, start=2, every=4) as video:
        assert (video.fps, video.length, read(video)) == (6.25, 5, 5)
        ticks = video.decoded.tick
        assert math.isnan(ticks[1])
        assert ticks[[2, 6, 10]].tolist() == [0, 1, 2]


class Camera(http.server.BaseHTTPRequestHandler):
    """Sends JPEG pictures, 30 a second for two seconds, and then keeps the line open until the test is over."""

    over: threading.Event
    sent: list[float]

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        began = time.monotonic()
        try:
            for n in range(60):
                data = cv2.imencode(".jpg", picture(n))[1].tobytes()
                self.wfile.write(b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(data))
                self.wfile.write(data + b"\r\n")
                self.sent.append(time.monotonic())
                time.sleep(max(0.0, began + (n + 1) / 30 - time.monotonic()))
            self.over.wait()
        except OSError:
            pass

    def log_message(self, *_: object) -> None:
        """Nothing."""


@pytest.mark.realtime
def test_a_camera_that_falls_silent_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with open_video(write(tmp_path / "clip.mp4"), SIZE) as video:
        read(video)  # a stream is stamped as it is read: what is imported and compiled for it must be there
    monkeypatch.setattr(readers, "SILENCE_S", 1.0)
    Camera.over, Camera.sent = threading.Event(), []
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Camera)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        with open_video(f"http://127.0.0.1:{server.server_port}/video.mjpg", SIZE) as video:
            with pytest.warns(UserWarning, match=r"ended after \d+ frames: it sent nothing for"):
                frames = read(video)
            assert 55 <= frames <= 60
            stamps = video.decoded.stamp
            assert stamps[-1] - stamps[0] == pytest.approx(Camera.sent[-1] - Camera.sent[0], abs=0.5)
            assert video.silent
    finally:
        Camera.over.set()
        server.shutdown()
        server.server_close()


class Server:
    """A web server with a film, lists that name the film of another server, and redirects there."""

    def __init__(self, film: bytes, other: str = "") -> None:
        asked = self.asked = list[str]()

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                asked.append(self.path)
                places = {"/moved": "/film.mp4", "/away": f"{other}/film.mp4"}
                self.send_response(302 if self.path in places else 200)
                if self.path in places:
                    self.send_header("Location", places[self.path])
                self.end_headers()
                self.wfile.write(b"" if self.path in places else LISTS.get(self.path, film).replace(b"OTHER", to))

            def log_message(self, *_: object) -> None: ...

        to = other.encode()
        self.http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        # "localhost" and "127.0.0.1" are two hosts for whoever compares names.
        self.address = f"http://127.0.0.1:{self.http.server_address[1]}"
        threading.Thread(target=self.http.serve_forever, daemon=True).start()


LISTS = {
    "/list.m3u8": b"#EXTM3U\n#EXT-X-TARGETDURATION:2\n#EXTINF:1,\nOTHER/film.ts\n#EXT-X-ENDLIST\n",
    "/list.ffconcat": b"ffconcat version 1.0\nfile OTHER/film.mp4\n",
    "/list.mpd": b"<?xml version='1.0'?><MPD><Period><BaseURL>OTHER/film.mp4</BaseURL></Period></MPD>",
}


@pytest.fixture
def servers(tmp_path: Path) -> Iterator[tuple[Server, Server]]:
    film = write(tmp_path / "film.mkv").read_bytes()
    other = Server(film)
    server = Server(film, other.address.replace("127.0.0.1", "localhost"))
    yield server, other
    for one in (server, other):
        one.http.shutdown()
        one.http.server_close()


@pytest.mark.parametrize("name", LISTS)
def test_a_playlist_has_nothing_opened(name: str, servers: tuple[Server, Server]) -> None:
    server, other = servers
    with pytest.raises(InputError, match="a list of others"):
        open_video(server.address + name)
    assert server.asked
    assert other.asked == []


@pytest.mark.parametrize("name", ["/moved", "/away"])
def test_redirects_are_refused(name: str, servers: tuple[Server, Server]) -> None:
    server, other = servers
    with pytest.raises(InputError, match="a redirect"):
        open_video(server.address + name)
    assert other.asked == []
    with open_video(server.address + "/film.mp4") as video:
        assert len(next(video.chunks(4))) == 4


@pytest.mark.parametrize("scheme", ["file", "concat", "subfile", "data", "gopher", "unix"])
def test_other_schemes_are_refused(scheme: str) -> None:
    with pytest.raises(InputError, match=f"begins with {scheme}://"):
        open_video(f"{scheme}:///etc/hostname")
