"""Where a view goes: into a file, to a viewer on this screen, or to a server for a viewer on another computer."""

from __future__ import annotations

import atexit
import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

from ndtorch.errors import InputError
from ndtorch.report.recording import import_rerun

LOCALHOST = "127.0.0.1"

PORT = 9876
"""Of a server, unless another is given: the one that viewers try first."""

SERVER_MEMORY = "256MB"
"""What a server keeps for viewers that connect later. The oldest data are dropped."""

START_TIMEOUT = 10.0
"""Seconds to wait for the viewer or server."""


class Where(NamedTuple):
    """Where to show something.

    Attributes:
        file: a `.rrd` file.
        window: the viewer, on this screen; it listens at 127.0.0.1 only.
        address: `ADDRESS` or `ADDRESS:PORT` at which a server listens for viewers.
    """

    file: Path | None = None
    window: bool = False
    address: str | None = None

    @property
    def anywhere(self) -> bool:
        """Whether anything is to be shown at all."""
        return self.file is not None or self.window or self.address is not None


def open_stream(name: str, where: Where, blueprint: Any) -> Any:
    """A rerun stream with its sinks.

    Call it before the program asks for real-time priority: what it starts would go before the loop as well.

    Args:
        name: of the recording.
        blueprint: how the viewer lays it out.

    Raises:
        InputError: rerun is not installed, the file cannot be written, or the viewer or server does not open.
    """
    rr = import_rerun()
    stream: Any = rr.RecordingStream(f"ndtorch {name}")
    sinks = []
    try:
        if where.file is not None:
            where.file.parent.mkdir(parents=True, exist_ok=True)
            where.file.touch()
            sinks.append(rr.FileSink(str(where.file)))
        if where.window:
            sinks.append(rr.GrpcSink(open_viewer()))
        if where.address is not None:
            sinks.append(rr.GrpcSink(open_server(where.address)))
        stream.set_sinks(*sinks, default_blueprint=blueprint)
    except (OSError, RuntimeError) as error:
        raise InputError(f"cannot write the recording {where.file}: {error}") from None
    return stream


def open_viewer() -> str:
    """Start the viewer, listening at 127.0.0.1 only; returns the address to send to."""
    with socket.socket() as free:
        free.bind((LOCALHOST, 0))
        port = free.getsockname()[1]
    failure = "the rerun viewer does not open (has this machine a screen?): use --rrd FILE instead of --view"
    start(["--hide-welcome-screen"], LOCALHOST, port, failure)
    return f"rerun+http://{LOCALHOST}:{port}/proxy"


def open_server(address: str) -> str:
    """Start a server for viewers elsewhere, which ends with this program; returns the address to send to."""
    host, _, given = address.partition(":")
    port = int(given or PORT) if (given or "0").isdigit() else 0
    if not host or not 0 < port < 65536:
        raise InputError(f"--view-at must be ADDRESS or ADDRESS:PORT, as 0.0.0.0:{PORT}, got {address!r}")
    try:
        with socket.create_server((host, port)):
            pass
    except OSError as error:
        raise InputError(f"--view-at {address}: cannot listen there ({error.strerror})") from None
    options = ["--serve-grpc", "--server-memory-limit", SERVER_MEMORY]
    server = start(options, host, port, f"--view-at {address}: the rerun server does not start")
    atexit.register(end, server)
    return f"rerun+http://{near(host)}:{port}/proxy"


def near(host: str) -> str:
    """Where a server that listens at `host` is reached from here."""
    return LOCALHOST if host == "0.0.0.0" else host


def start(options: list[str], host: str, port: int, failure: str) -> subprocess.Popen[bytes]:
    """Start rerun in a process of its own and wait until it listens; raises `InputError` with `failure`."""
    command = [sys.executable, "-m", "rerun", "--bind", host, "--port", str(port), *options]
    viewer = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    until = time.monotonic() + START_TIMEOUT
    while time.monotonic() < until and viewer.poll() is None:
        with socket.socket() as line:
            line.settimeout(0.2)
            if line.connect_ex((near(host), port)) == 0:
                return viewer
        time.sleep(0.1)
    end(viewer)
    raise InputError(failure)


def end(viewer: subprocess.Popen[bytes]) -> None:
    """End a viewer or server with all its processes: what was started only starts the program."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(viewer.pid, signal.SIGTERM)
