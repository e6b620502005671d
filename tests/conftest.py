"""One thread and fixed seeds for every test: two threads collapse when the other core is busy.

Real-time tests that failed are run again; while the machine stalls a failure does not count. See `tests/stalls.py`.
"""

import contextlib
import os
import signal
import tempfile
import threading
from pathlib import Path

import pytest
import torch
from _pytest.runner import runtestprotocol

from tests.compilers import broken_compiler
from tests.films import Films, shared_folder
from tests.stalls import Again, StallMeter

torch.set_num_threads(1)
METER, AGAIN = pytest.StashKey(), pytest.StashKey()


@pytest.fixture(autouse=True)
def fixed_seed() -> None:
    """The same random numbers whatever ran before."""
    torch.manual_seed(0)


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
        # In the background Ctrl-C is ignored, and children inherit that.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        # So is SIGHUP below nohup.
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
    for name in ("HOME", "XDG_CACHE_HOME"):
        place = os.environ.get(name)
        if place is not None and not os.access(place, os.W_OK | os.X_OK):
            # Kept for all processes of a run, and small: fonts that matplotlib has found.
            os.environ[name] = str(Path(tempfile.gettempdir(), f"ndtorch-tests-{os.getuid()}"))
            Path(os.environ[name]).mkdir(mode=0o700, exist_ok=True)


def pytest_collection_modifyitems(items):
    """Whole runs come last, and what is compiled at the very end: what is quick fails first.

    Tests of the marker long run with `-m long` only: see CONTRIBUTING.md.
    """
    if items and from_both_ends(items[0].config):
        items.sort(key=lambda item: item.path.parts)
    items.sort(key=lambda item: [item.get_closest_marker(name) is not None for name in ("compiled", "slow")])


def from_both_ends(config):
    """Whether two workers read the files from both ends, in the order of their names."""
    return "PYTEST_XDIST_WORKER" in os.environ and config.getoption("--shuffle", None) is None


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    """The second worker reads folders from their end: what one has compiled the other finds."""
    report = yield
    second = os.environ.get("PYTEST_XDIST_WORKER") == "gw1"
    if second and isinstance(collector, pytest.Directory) and from_both_ends(collector.config):
        report.result = report.result[::-1]
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item):
    with compilable(item):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem):
    with compilable(pyfuncitem):
        return (yield)


@contextlib.contextmanager
def compilable(item):
    """A test of the marker compiled is skipped where `torch.compile` itself is broken."""
    try:
        yield
    except Exception as error:
        if item.get_closest_marker("compiled") is None or not (why := broken_compiler(error)):
            raise
        pytest.skip(why)


def meter(config):
    """The stall meter, started when it is first wanted."""
    if METER not in config.stash:
        config.stash[METER] = StallMeter()
        config.stash[AGAIN] = Again(config.stash[METER].worst)
    return config.stash[METER]


@pytest.fixture
def stall_meter(request):
    return meter(request.config)


def pytest_unconfigure(config):
    if METER in config.stash:
        config.stash[METER].close()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item, nextitem):
    """A real-time test that failed is run again: while the machine stalled it has shown nothing."""
    if item.get_closest_marker("realtime") is None:
        return None
    reports, failures = [], []

    def work():
        reports[:] = runtestprotocol(item, log=False, nextitem=nextitem)
        failed = [report for report in reports if report.failed]
        failures.extend(str(getattr(report.longrepr, "reprcrash", report.longrepr)) for report in failed)
        return not failed

    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    meter(item.config)
    went_well, stalls = item.config.stash[AGAIN].run(work)
    told = " and ".join(f"{1e3 * stall:.0f} ms" for stall in stalls)
    for report in reports:
        if stalls:
            report.user_properties.append(("stalls", f"{told}: {failures[: len(stalls)]}"))
        if report.failed and went_well is None:
            why = f"Skipped: failed while the machine stalled for {told}: nothing can be timed on it"
            report.outcome, report.longrepr = "skipped", (str(item.path), item.location[1] or 0, why)
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def pytest_terminal_summary(terminalreporter):
    """Name the tests that were run again."""
    for outcome in ("passed", "failed", "error"):
        for report in terminalreporter.stats.get(outcome, []):
            for name, stalls in getattr(report, "user_properties", []):
                if name == "stalls" and (report.when == "call" or outcome != "passed"):
                    terminalreporter.write_line(f"failed and run again, {report.nodeid}, longest stalls {stalls}")
