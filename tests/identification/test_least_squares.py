"""The least squares of the torque equations, against a closed form of errors in variables."""

import numpy as np
import pytest
from scipy.sparse import eye_array, kron

from framework.identification.least_squares import estimate
from framework.identification.measured_motion import SplineErrors
from framework.identification.torque_rows import TorqueRows


@pytest.mark.parametrize("of_torque", [0.6, 0.05])
def test_a_noisy_acceleration_attenuates_nothing_and_widens_the_interval(of_torque):
    """One inertia b, torques b a + e and accelerations a + u: Fuller (1987), section 1.3, known variances.

    Each of G accelerations with one error u holds for four torques, whose mean has the error e. With
    v = e - b u the variance of b is (1 + G var(e) var(u) / (var(v) sum a^2)) var(v) / sum a^2. Ordinary least
    squares would find b / (1 + G var(u) / sum a^2). If e is far smaller than b u, the torques show more of u
    than of b: taken for noise, this would leave b = 0.
    """
    G, inertia, noise = 400, 1.3, 0.6
    random = np.random.default_rng(3)
    exact = np.sqrt(2.0) * np.sin(0.2 * np.arange(G))
    u = noise * random.standard_normal(G)
    e = 2.0 * of_torque * random.standard_normal(4 * G)
    rows = TorqueRows(
        times=0.01 * np.arange(4 * G),
        matrix=np.repeat(exact + u, 4)[:, None, None],
        response=np.ones((4 * G, 1, 1, 1)),
        constant=np.zeros((4 * G, 1)),
        torque=(inertia * np.repeat(exact, 4) + e)[:, None],
        valid=np.ones((4 * G, 1), dtype=bool),
        independent=1.0,
        errors=SplineErrors(eye_array(G, format="csr"), noise * kron(eye_array(G), np.ones((4, 1)), "csr")),
    )
    found = estimate(rows, np.array([[10.0]]), np.zeros(1), {})
    squares = exact @ exact
    of_v = of_torque**2 + (inertia * noise) ** 2
    deviation = np.sqrt(of_v / squares * (1.0 + G * (of_torque * noise) ** 2 / of_v / squares))
    assert 10.0 * abs(found.spread[0, 0]) == pytest.approx(deviation, rel=0.05)
    attenuated = inertia / (1.0 + G * noise**2 / squares)
    assert abs(10.0 * found.values[0] - inertia) < 2.0 * deviation
    assert abs(attenuated - inertia) > 6.0 * deviation


def test_forces_that_no_parameter_makes_leave_no_more_than_the_torques_themselves():
    """A force at 2 Hz beside that of an inertia b: least squares find b, as the two are orthogonal.

    At 20 Hz there is little motion and a small force, by which b alone would be 6 times as large. Weights
    that take what is left at 2 Hz for noise lead there, and leave 3.6 times the torques.
    """
    t = 0.01 * np.arange(1000)
    slow, fast = 2.0 * np.pi * 2.0 * t, 2.0 * np.pi * 20.0 * t
    acceleration = np.sin(slow) + 0.02 * np.sin(fast)
    noise = 0.003 * np.random.default_rng(0).standard_normal(len(t))
    torque = acceleration + np.cos(slow) + 0.1 * np.sin(fast) + noise
    none = eye_array(len(t), format="csr")
    rows = TorqueRows(
        times=t,
        matrix=acceleration[:, None, None],
        response=np.zeros((len(t), 1, 1, 1)),
        constant=np.zeros((len(t), 1)),
        torque=torque[:, None],
        valid=np.ones((len(t), 1), dtype=bool),
        independent=1.0,
        errors=SplineErrors(none, none),
    )
    found = estimate(rows, np.array([[10.0]]), np.zeros(1), {})
    assert found.noise[0] < np.sqrt(np.mean(torque**2))
    inertia = 10.0 * found.values[0]
    assert abs(inertia - 1.0) < abs(inertia - 6.0)
