"""What is run again, what fails at once, and that the meter notices."""

import os
import signal
import time

import pytest

from tests.stalls import ATTEMPTS, Again, StallMeter, lost


def attempts(outcomes, stalls):
    """Runs with these outcomes, during which the machine stalled for so long; returns the result and how many ran."""
    ran = []

    def work():
        ran.append(outcomes[len(ran)])
        return ran[-1]

    return Again(lambda since: stalls[len(ran) - 1]).run(work), len(ran)


def test_what_fails_twice_on_a_machine_that_works_has_failed():
    assert attempts([False, False], [0.05, 0.0]) == ((False, [0.05]), 2)
    assert attempts([False, True], [0.05, 0.0]) == ((True, [0.05]), 2)
    assert attempts([False, False, False], [0.3, 0.01, 0.0]) == ((False, [0.3, 0.01]), 3)


def test_one_failure_among_stalls_shows_nothing():
    assert attempts([False] * ATTEMPTS, [0.3, 0.01, 0.3]) == ((None, [0.3, 0.01, 0.3]), ATTEMPTS)


def test_what_fails_in_a_stall_is_run_again():
    assert attempts([False, True], [0.3, 0.3]) == ((True, [0.3]), 2)
    assert attempts([True], [0.3]) == ((True, []), 1)
    assert attempts([False] * ATTEMPTS, [0.3, 0.2, 0.1]) == ((None, [0.3, 0.2, 0.1]), ATTEMPTS)


def test_patience_ends():
    again = Again(lambda since: 0.3)
    again.patience = 0.1
    assert again.run(lambda: time.sleep(0.06)) == (None, [0.3] * 3)  # the first attempt costs nothing
    assert again.run(lambda: time.sleep(0.06)) == (None, [0.3])


def test_short_stalls_of_one_processor_count_together():
    assert lost([]) == 0.0
    assert lost([(1.0, 0.03, 0), (1.1, 0.03, 0), (1.2, 0.02, 0)]) == pytest.approx(0.08)
    assert lost([(1.0, 0.03, 0), (1.1, 0.03, 1), (1.4, 0.02, 0)]) == pytest.approx(0.03)


def test_the_meter_notices_a_stall():
    meter = StallMeter()
    try:
        began = time.monotonic()
        time.sleep(0.05)
        os.kill(meter.process.pid, signal.SIGSTOP)
        time.sleep(0.15)
        os.kill(meter.process.pid, signal.SIGCONT)
        noted = began + 30.0  # on a machine with much else to do it goes on when it may
        while (worst := meter.worst(began)) <= 0.12 and time.monotonic() < noted:
            pass
        assert worst > 0.12
    finally:
        meter.close()
    with pytest.raises(ProcessLookupError):
        os.kill(meter.process.pid, 0)
