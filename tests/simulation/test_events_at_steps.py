"""A zero at the very instant where one step ends and the next begins is seen, and once."""

import numpy as np
import pytest

import robots
from framework import InvalidInput, simulate
from framework.simulation import Event


@pytest.mark.parametrize("method", ["reference", "stiff", "fast"])
def test_a_zero_between_two_steps_is_seen_once(method):
    robot = robots.load("five_bar")
    for instant in np.linspace(0.01, 0.09, 9):
        event = Event(lambda t, q, v, instant=instant: t - instant)
        result = simulate(
            robot, lambda t: [0, 0], method=method, duration=0.1, breaks=[instant], events=[event]
        )
        assert [one.time for one in result.occurrences] == pytest.approx([instant], abs=1e-14)


@pytest.mark.parametrize("value", [np.nan, None, [1.0, 2.0], "a"])
def test_what_is_no_number_is_refused(value):
    event = Event(lambda t, q, v: value if t > 0.02 else 1.0, name="gauge")
    with pytest.raises(InvalidInput, match="gauge"):
        simulate(robots.load("five_bar"), lambda t: [0, 0], duration=0.05, events=[event])
