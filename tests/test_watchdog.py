"""Work is bounded, waiting for a turn is not, and what hangs is ended."""

import os
import signal
import time

import pytest

from tests.watchdog import bounded


def test_time_in_which_others_work_is_not_counted():
    with bounded(0.1):
        time.sleep(0.2)


def work(seconds: float) -> None:
    """Keep the processor busy."""
    until = time.thread_time() + seconds
    while time.thread_time() < until:
        pass


def test_too_much_work_fails():
    with pytest.raises(AssertionError, match=r"processor time; at most 0\.05 s"), bounded(0.05):
        work(0.06)


def test_what_waits_for_ever_is_ended_and_the_next_is_not(tmp_path):
    before = signal.getsignal(signal.SIGALRM)
    os.mkfifo(tmp_path / "fifo")
    with pytest.raises(pytest.fail.Exception, match=r"not done within 0\.1 s"), bounded(5.0, hang=0.1):
        (tmp_path / "fifo").read_text(encoding="utf-8")  # nobody will ever write into it
    assert signal.getsignal(signal.SIGALRM) == before
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
