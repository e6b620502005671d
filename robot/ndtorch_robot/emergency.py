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

from ndtorch_robot.safety import SafeDrive

HELP = "any key: emergency stop   g: go (resume)   Ctrl-C: stop and end"


@contextmanager
def emergency_stops(
    drive: SafeDrive, ended: threading.Event | None = None, keys: bool = True
) -> Iterator[threading.Event]:
    """Watch for signals, and for keys when stdin is a terminal, in a thread of its own; for the main thread only.

    SIGTERM, SIGINT and SIGHUP stop the car at once, even while the main thread is inside of a long call, and set the
    event, which tells the loop to end. SIGUSR1 and the key g resume; any other key is an emergency stop.
    """
    ended = ended or threading.Event()
    wake, woken = os.pipe()
    os.set_blocking(woken, False)
    signals = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGUSR1)
    # The interpreter writes the number of a signal to this pipe when it comes, whatever Python code is doing.
    old_pipe = signal.set_wakeup_fd(woken, warn_on_full_buffer=False)
    old = {number: signal.signal(number, lambda number, frame: None) for number in signals}
    stdin = sys.stdin.fileno() if keys and sys.stdin.isatty() else None
    terminal = termios.tcgetattr(stdin) if stdin is not None else None
    if stdin is not None:
        tty.setcbreak(stdin)
    thread = threading.Thread(target=watch, args=(drive, wake, stdin, ended), name="emergency", daemon=True)
    thread.start()
    try:
        yield ended
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
        ready, _, _ = select.select(watched, [], [])
        for file in ready:
            data = os.read(file, 1)
            if not data and file == wake:
                return
            if not data:
                watched.remove(file)
            elif file == stdin:
                if data in (b"g", b"G"):
                    drive.resume()
                else:
                    drive.emergency(f"key {data.decode('latin-1')!r}")
            elif data[0] == signal.SIGUSR1:
                drive.resume()
            else:
                ended.set()
                drive.emergency(signal.Signals(data[0]).name)
