"""The slider-crank with a rod that gives way, against Lagrange's equations written down for it alone.

Coordinates: the crank's angle, the slide, and the ball screw before its spring. The rod points from the
crank's pin to the slider, and its spring feels what the distance differs from 0.12 m.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from framework import simulate

ROBOT = "slider_crank"
FLEXIBILITY = "flexible_links"
CRANK, ROD, OFFSET = 0.04, 0.12, -0.02  # [m]
FLYWHEEL, ROD_MASS, SLIDER = 2.05, 0.12, 0.3  # [kg]
FLYWHEEL_CENTRE, ROD_CENTRE = 0.001, 0.06  # [m]
FLYWHEEL_INERTIA, ROD_INERTIA = 0.0082, 1.5e-4  # [kg m^2]
GEAR, ROTOR = 314.1592653589793, 5e-6
SCREW, LENGTH = 100000.0, 200000.0  # [N/m]
GRAVITY = 9.81
STEP = 1e-30  # of complex differentiation, which has no cancellation


def rod(y):
    """Vector from pin to slider."""
    return y[1] - CRANK * np.cos(y[0]), OFFSET - CRANK * np.sin(y[0])


def mass_matrix(y):
    c, s, (dx, dy) = np.cos(y[0]), np.sin(y[0]), rod(y)
    square = dx * dx + dy * dy
    length = np.sqrt(square)
    # d(phi) = (dx d(dy) - dy d(dx)) / square, by angle and slide
    turn = np.array([(-dx * CRANK * c - dy * CRANK * s) / square, -dy / square])
    ux, uy = dx / length, dy / length
    centre_x = np.array([-CRANK * s - ROD_CENTRE * uy * turn[0], -ROD_CENTRE * uy * turn[1]])
    centre_y = np.array([CRANK * c + ROD_CENTRE * ux * turn[0], ROD_CENTRE * ux * turn[1]])
    inner = ROD_MASS * (np.outer(centre_x, centre_x) + np.outer(centre_y, centre_y))
    inner = inner + ROD_INERTIA * np.outer(turn, turn)
    whole = np.zeros((3, 3), dtype=inner.dtype)
    whole[:2, :2] = inner
    whole[0, 0] += FLYWHEEL_INERTIA + FLYWHEEL * FLYWHEEL_CENTRE**2
    whole[1, 1] += SLIDER
    whole[2, 2] += GEAR**2 * ROTOR
    return whole


def potential(y):
    dx, dy = rod(y)
    length = np.sqrt(dx * dx + dy * dy)
    height = FLYWHEEL * FLYWHEEL_CENTRE * np.sin(y[0])
    height = height + ROD_MASS * (CRANK * np.sin(y[0]) + ROD_CENTRE * dy / length)
    return GRAVITY * height + 0.5 * LENGTH * (length - ROD) ** 2 + 0.5 * SCREW * (y[1] - y[2]) ** 2


def acceleration(torque, y, rate):
    moved = [y + 1j * STEP * e for e in np.eye(3)]
    by_y = np.array([mass_matrix(one).imag / STEP for one in moved])  # (k, i, j)
    slope = np.array([potential(one).imag / STEP for one in moved])
    inertia = np.einsum("kij,k,j->i", by_y, rate, rate) - 0.5 * np.einsum("kij,i,j->k", by_y, rate, rate)
    return np.linalg.solve(mass_matrix(y), np.array([0, 0, GEAR * torque]) - inertia - slope)


def torque(t):
    return 0.02 * np.sin(30.0 * t)


@pytest.fixture(scope="module")
def witness(robot):
    """Times (T,) and coordinates (T, 3): Lagrange's equations, integrated."""
    start = simulate(robot, lambda t: [torque(t)], duration=1e-3)
    angle, slide, screw = (column[0] for column in coordinates(robot, start.q))

    def slope(t, state):
        return np.concatenate([state[3:], acceleration(torque(t), state[:3], state[3:])])

    times, initial = np.linspace(0, 0.15, 16), np.array([angle, slide, screw, 0, 0, 0])
    found = solve_ivp(slope, (0, 0.15), initial, "DOP853", rtol=1e-11, atol=1e-13, t_eval=times)
    return times, found.y[:3].T


def coordinates(robot, q):
    """Crank, slide and screw, each (T,)."""
    by_name = {robot.coordinates.name_of(c): q[:, c] for c in range(robot.model.nv)}
    spring = robot.elastic[robot.elastic_names.index("screw")]
    return by_name["crank_bearing"], by_name["slide"] + q[:, spring], by_name["slide"]


@pytest.mark.parametrize(("method", "apart"), [("reference", 1e-9), ("stiff", 1e-5)])
def test_flexible_slider_crank(robot, witness, method, apart):
    result = simulate(robot, lambda t: [torque(t)], duration=0.15, method=method)
    times, theirs = witness
    assert np.ptp(theirs[:, 0]) > 0.02  # the crank moves, and the springs ring
    ours = np.column_stack(coordinates(robot, result.configuration(times)))
    np.testing.assert_allclose(ours, theirs, atol=apart)
    assert result.energy_error < apart
