"""One thread, fixed seeds and no signals for every test: two threads collapse when the other core is busy."""

import os
import signal
import tempfile
import threading
from pathlib import Path

import pytest
import torch
from _pytest.runner import runtestprotocol

from ndtorch.utils.signals import CAME
from tests.films import Films, shared_folder

torch.set_num_threads(1)


@pytest.fixture(autouse=True)
def fresh_start():
    """The same random numbers whatever ran before, and no signal that came to another test."""
    torch.manual_seed(0)
    yield
    CAME.clear()


@pytest.fixture(scope="session")
def films(tmp_path_factory):
    """Sums of rendered scenes; see `tests/films.py`."""
    return Films(shared_folder(tmp_path_factory.getbasetemp()))


@pytest.fixture(scope="session")
def bars(films):
    """Films of three bars, each alone."""
    return films.bars()


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """One second of the two bars at 25 frames a second, small, as a video file."""
    from tests.command_line import small_clip

    return small_clip(tmp_path_factory.mktemp("clip") / "bars.avi")


@pytest.fixture
def undrawn(monkeypatch):
    """Without figures, for tests of something else: drawing them takes longer than a short run."""
    monkeypatch.setattr("ndtorch.report.page.draw_all", lambda result, folder: [])


def pytest_configure():
    """Nothing that a shell hands down matters: ignored signals, a home that cannot be written to."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored below nohup
    for name in ("HOME", "XDG_CACHE_HOME"):
        folder = os.environ.get(name)
        if folder is not None and not os.access(folder, os.W_OK | os.X_OK):
            os.environ[name] = str(Path(tempfile.gettempdir(), f"ndtorch-tests-{os.getuid()}"))
            Path(os.environ[name]).mkdir(mode=0o700, exist_ok=True)


def pytest_collection_modifyitems(items):
    """Whole runs come last, and what is compiled at the very end: what is quick fails first."""
    items.sort(key=lambda item: [item.get_closest_marker(name) is not None for name in ("compiled", "slow")])


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item, nextitem):
    """A real-time test that failed is run once more: the machine may have stalled."""
    if item.get_closest_marker("realtime") is None:
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    reports = runtestprotocol(item, log=False, nextitem=nextitem)
    if any(report.failed for report in reports):
        reports = runtestprotocol(item, log=False, nextitem=nextitem)
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True
