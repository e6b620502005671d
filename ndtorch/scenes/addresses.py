"""Addresses of films and streams: one is opened, and what it says cannot have another one opened."""

from __future__ import annotations

import contextlib
import http.client
import os
from collections.abc import Iterator
from urllib.parse import urljoin, urlsplit

from ndtorch.errors import InputError

SCHEMES = ("http", "https", "rtsp", "rtsps", "rtmp", "rtmps", "rtp", "udp", "srt", "tcp")
"""Addresses that are opened. FFmpeg knows others that name files, or several addresses in one."""

FORMATS = (
    "mov,mp4,matroska,webm,avi,mpegts,mpeg,mpegvideo,flv,asf,ogg,mpjpeg,mjpeg,jpeg_pipe,h264,hevc,av1,obu,ivf,m4v,gif,"
    "mxf,nut,yuv4mpegpipe,rtsp,sdp,rtp"
)
"""Formats that hold pictures themselves. Playlists (HLS, DASH, concat and others) name further addresses."""

VARIABLE = "OPENCV_FFMPEG_CAPTURE_OPTIONS"

REDIRECTS = 5
"""Most redirects that are followed."""

PATIENCE = 10.0
"""Seconds to wait for a server."""

PORTS = {"http": 80, "https": 443}


@contextlib.contextmanager
def limited_ffmpeg(address: bool) -> Iterator[None]:
    """What FFmpeg inside OpenCV may open: of an address the formats of one film, and no redirects; of a file, files."""
    ours = f"max_redirects;0|format_whitelist;{FORMATS}" if address else "protocol_whitelist;file,pipe,fd"
    before = os.environ.get(VARIABLE)
    # What OpenCV uses where nothing is set; the last of two values counts.
    os.environ[VARIABLE] = f"{before or 'rtsp_flags;prefer_tcp'}|{ours}"
    try:
        yield
    finally:
        if before is None:
            del os.environ[VARIABLE]
        else:
            os.environ[VARIABLE] = before


def check_scheme(address: str) -> None:
    """Raise `InputError` for an address whose scheme is not one of `SCHEMES`."""
    scheme = address.partition("://")[0].lower()
    if scheme not in SCHEMES:
        what = "a file is named by its path" if scheme == "file" else f"there are {', '.join(SCHEMES)}"
        raise InputError(f"source cannot be an address that begins with {scheme}://; {what}")


def redirected(address: str, follow_redirects: bool) -> str:
    """Where the server of an address redirects to in the end, within its own host; else the address itself."""
    for _ in range(REDIRECTS):
        to = redirect_of(address)
        if to is None:
            return address
        old, new = urlsplit(address), urlsplit(to)
        if new.scheme not in PORTS:
            raise InputError(f"{address} redirects to {to}, which is no address of a film")
        if new.hostname != old.hostname and not follow_redirects:
            raise InputError(f"{address} redirects to another host, {to}; name that address, or add --follow-redirects")
        address = to
    raise InputError(f"{address} redirects more than {REDIRECTS} times")


def redirect_of(address: str) -> str | None:
    """Where a web server redirects to; None where it does not, or does not answer."""
    try:
        parts = urlsplit(address)
        if parts.scheme not in PORTS or parts.hostname is None:
            return None
        kind = http.client.HTTPSConnection if parts.scheme == "https" else http.client.HTTPConnection
        connection = kind(parts.hostname, parts.port, timeout=PATIENCE)
        with contextlib.closing(connection):
            # Cameras do not know HEAD. What follows the header is not read.
            path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
            connection.request("GET", path, headers={"User-Agent": "ndtorch"})
            answer = connection.getresponse()
            place = answer.getheader("Location")
            return urljoin(address, place) if 300 <= answer.status < 400 and place else None
    except (OSError, ValueError, http.client.HTTPException):
        return None
