"""Emergency stop by key and by signal, without waiting for the loop."""

from __future__ import annotations

import os
import select
import signal
import sys
import termios
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from ndtorch.utils.signals import CAME
from ndtorch_robot.safety import SafeDrive

HELP = "any key: emergency stop   g: go (resume)   Ctrl-C: stop and end"

SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGUSR1)


def note(number: int, frame: FrameType | None) -> None:
    """Remember that a signal that ends programs came."""
    if number != signal.SIGUSR1:
        CAME.append(number)


@contextmanager
def emergency_stops(drive: SafeDrive, ended: threading.Event) -> Iterator[None]:
    """Watch for signals, and for keys when stdin is a terminal, in a thread of its own; for the main thread only.

    SIGTERM, SIGINT and SIGHUP stop the car at once, even while the main thread is inside of a long call, and set the
    event, which tells the loop to end. SIGUSR1 and the key g resume; any other key is an emergency stop.
    """
    wake, woken = os.pipe()
    os.set_blocking(woken, False)
    # The interpreter writes the number of a signal to this pipe when it comes, whatever Python code is doing.
    old_pipe = signal.set_wakeup_fd(woken, warn_on_full_buffer=False)
    old = {number: signal.signal(number, note) for number in SIGNALS}
    stdin = sys.stdin.fileno() if sys.stdin.isatty() else None
    terminal = None if stdin is None else termios.tcgetattr(stdin)
    if stdin is not None:
        tty.setcbreak(stdin)
    thread = threading.Thread(target=watch, args=(drive, wake, stdin, ended), name="emergency", daemon=True)
    thread.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(old_pipe)
        for number, handler in old.items():
            signal.signal(number, handler)
        if stdin is not None and terminal is not None:
            termios.tcsetattr(stdin, termios.TCSADRAIN, terminal)
        os.close(woken)  # ends the thread
        thread.join(1.0)
        os.close(wake)


def watch(drive: SafeDrive, wake: int, stdin: int | None, ended: threading.Event) -> None:
    """Until the other end of `wake` is closed."""
    watched = [wake] if stdin is None else [wake, stdin]
    while True:
        for file in select.select(watched, [], [])[0]:
            data = os.read(file, 1)
            if not data and file == wake:
                return
            if not data:
                watched.remove(file)
            elif data in b"gG" if file == stdin else data[0] == signal.SIGUSR1:
                drive.resume()
            elif file == stdin:
                drive.emergency(f"key {data.decode('latin-1')!r}")
            else:
                ended.set()
                drive.emergency(signal.Signals(data[0]).name)
