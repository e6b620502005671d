"""Addresses: one film is opened, and neither a playlist nor a redirect has another host asked."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from ndtorch.errors import InputError
from ndtorch.scenes import open_video
from tests.scenes.clips import write


class Server:
    """A web server with a film, lists that name the film of another server, and redirects there."""

    def __init__(self, film: bytes, other: str = "") -> None:
        asked = self.asked = list[str]()

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                asked.append(self.path)
                places = {"/moved": "/film.mp4", "/away": f"{other}/film.mp4", "/round": "/round", "/file": "file:///x"}
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
        open_video(server.address + name, follow_redirects=True)
    assert server.asked
    assert other.asked == []


def test_redirects_stay_on_their_host_unless_others_are_allowed(servers: tuple[Server, Server]) -> None:
    server, other = servers
    for name in ("/film.mp4", "/moved"):
        with open_video(server.address + name) as video:
            assert len(next(video.chunks(4))) == 4
    with pytest.raises(InputError, match=r"redirects to another host.*--follow-redirects"):
        open_video(server.address + "/away")
    assert other.asked == []
    with open_video(server.address + "/away", follow_redirects=True) as video:
        assert len(next(video.chunks(4))) == 4
    assert set(other.asked) == {"/film.mp4"}


@pytest.mark.parametrize(("name", "words"), [("/round", "more than 5 times"), ("/file", "no address of a film")])
def test_redirects_that_lead_nowhere(name: str, words: str, servers: tuple[Server, Server]) -> None:
    with pytest.raises(InputError, match=words):
        open_video(servers[0].address + name, follow_redirects=True)


@pytest.mark.parametrize("scheme", ["file", "concat", "subfile", "data", "gopher", "unix"])
def test_other_schemes_are_refused(scheme: str) -> None:
    with pytest.raises(InputError, match=f"begins with {scheme}://"):
        open_video(f"{scheme}:///etc/hostname")
